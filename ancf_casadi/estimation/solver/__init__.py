"""Bounded nonlinear least squares: the unknowns, their solution by IPOPT and Gauss-Newton steps, and the noise."""
