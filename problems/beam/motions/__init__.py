"""Measured motions of a beam: records, weights, the block of a fit, and predictions."""
