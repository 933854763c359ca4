"""``python -m depth_pose.cli``."""

from depth_pose.cli import main

main()
