"""Steady-state vibration: periodic motion, response curves and backbones by harmonic balance, and small motion."""
