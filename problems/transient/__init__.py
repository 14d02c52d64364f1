"""Fits of damping laws and beam properties to large motion of the nonlinear beam, and the comparison of laws."""
