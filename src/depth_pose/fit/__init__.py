"""Fitting the body to points: CPD, Laplacian completion, the articulated fit, rendered-depth comparison."""
