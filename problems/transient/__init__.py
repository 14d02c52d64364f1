"""Fits of damping laws and beam properties to large motion, and the comparison of laws."""
