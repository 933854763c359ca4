"""The articulated fit, limb search, priors and personal builds (Ye et al. Sec. 6)."""
