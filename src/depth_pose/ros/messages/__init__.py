"""Conversions between the core types and ROS messages, without computations.

Clouds stay float32, transforms and joint positions float64. The float32 fields of the messages (probability,
confidence, residual, scale, build) round values between stages: live and offline runs agree within 0.1 mm.
"""
