"""Failure check, temporal registration, confidence and filter (Ye et al. Sec. 6)."""
