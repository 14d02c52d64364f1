"""Exact derivatives of a motion with respect to the parameters of the law, the base motion, the beam and the start.

``tangent`` linearises a Radau step, ``release_load`` the start.  ``run`` holds a computed motion and its
samples, and ``chain`` goes through its steps, forward and in reverse.  ``sensitivity`` joins these parts for one
motion, and ``differentiable`` makes a CasADi Function of it, ``motion``.  ``reading`` has what sensors read in it.
"""
