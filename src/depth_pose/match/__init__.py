"""Canonical axes, search, placement and size (Ye et al. Sec. 5)."""
