"""Between ROS messages and the core's types; nothing is computed here but layout.

What the nodes hand to each other comes back bit for bit: clouds stay float32, transforms and
joint positions float64. The few float32 fields of ``depth_pose_msgs/Skeleton`` (confidence,
residual, scale and the joints' confidence) hold values that the core has already rounded.
"""
