"""The equation of motion as CasADi Functions for other programs."""
