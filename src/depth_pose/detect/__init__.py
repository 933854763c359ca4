"""People in one frame: the people finder, the joint finder, masks."""
