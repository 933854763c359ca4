"""Coherent point drift, Laplacian completion and joint transfer (Ye et al. Sec. 6)."""
