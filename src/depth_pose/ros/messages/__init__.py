"""Conversions between the core types and ROS messages; nothing is computed here but layout.

Clouds stay float32, transforms and joint positions float64. The float32 fields of the messages (probability,
confidence, residual, scale, build) round what the stages hand on: live and offline runs agree within 0.1 mm.
"""
