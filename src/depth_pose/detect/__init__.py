"""Everybody in one frame: the people finder, the second look, masks."""
