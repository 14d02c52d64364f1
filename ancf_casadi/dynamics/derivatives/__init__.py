"""Exact derivatives of a motion with respect to the parameters of the law, the base motion, the beam and the start.

``tangent`` linearises a Radau step and goes through the steps of a motion, forward and in reverse.  ``run`` holds a
computed motion and its samples.  ``sensitivity`` joins these with the derivatives of the start (``dynamics.start``),
and ``differentiable`` makes a CasADi Function of it, ``motion``.  ``reading`` has what sensors read in a motion.
"""
