"""Modified locally optimal projection (Ye et al. Sec. 4)."""
