"""Canonical axes, search, placing and size (Ye et al. Sec. 5)."""
