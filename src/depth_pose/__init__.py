"""3D human pose from a depth sensor, on ROS 2 or in plain Python.

The method is `depth_pose.pipeline.PosePipeline`; every step of it lives in
`depth_pose.pipeline`. Only `depth_pose.ros` knows ROS.
"""

__version__ = "0.1.0"
