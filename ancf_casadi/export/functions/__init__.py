"""The equation of motion, Eq. (6) with damping, as CasADi Functions for other programs.

``motion_functions`` has the terms of the equation and their derivatives, ``statics`` the equilibrium and the natural
frequencies, Eq. (30), ``step`` one time step, and ``newton`` Newton's method, which ``statics`` and ``step`` embed.
"""
