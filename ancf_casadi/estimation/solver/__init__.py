"""Bounded nonlinear least squares: the unknowns, and their solution by Gauss-Newton steps or IPOPT."""
