"""The articulated fit, the solver, priors and personal builds (Ye et al. Sec. 6)."""
