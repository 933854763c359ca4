"""Scores against true joints, and pictures of the results."""
