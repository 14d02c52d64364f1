"""Measured response curves of a beam: records, their harmonic balance, the block of a fit."""
