"""Harmonic balance of second-order systems, those of the full and the reduced beam among them, and continuation."""
