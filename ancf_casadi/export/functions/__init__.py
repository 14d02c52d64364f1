"""The equation of motion, Eq. (6) with damping, as CasADi Functions for other programs."""
