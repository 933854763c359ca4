"""People in one frame: detection, joint proposals, masks."""
