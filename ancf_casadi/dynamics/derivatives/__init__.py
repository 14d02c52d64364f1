"""Exact derivatives of a motion with respect to the parameters of the law, the base motion, the beam and the start.

``tangent`` holds a computed motion, linearises its Radau steps and goes through them, forward and in reverse.
``sensitivity`` joins this with the derivatives of the start, and ``differentiable`` makes a CasADi Function of it,
``motion``.  ``reading`` has what sensors read in a motion.
"""
