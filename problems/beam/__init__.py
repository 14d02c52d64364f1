"""Fits of damping laws and properties of a beam to any mix of measurements (``fitting``)."""
