"""The volume tracker: a person's pose from the volume seen in silhouettes or depth images.

Hirai, Ukita, Kidode, *Real-time Pose Regression with Fast Volume Descriptor Computation*.
"""
