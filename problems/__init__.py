"""The estimation problems of the paper, stated on the tools of ``ancf_casadi``."""
