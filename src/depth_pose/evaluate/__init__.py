"""Scores against known joints, and pictures of the results."""
