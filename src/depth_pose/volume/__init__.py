"""The volume tracker: a person's pose from the volume that several silhouettes, or depth images, cut out.

Hirai, Ukita, Kidode, *Real-time Pose Regression with Fast Volume Descriptor Computation*.
"""
