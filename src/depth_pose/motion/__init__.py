"""Motion: clips, motion-capture files and retargeting, and the motion generator."""
