"""Rayleigh damping from modal damping ratios, Eq. (17)."""
