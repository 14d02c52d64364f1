"""Exact derivatives of a motion with respect to the parameters of the law, the base motion, the beam and the start.

``tangent`` and ``linearised`` linearise a Radau step; ``release_load`` and ``differentiable_start`` the start.  ``run``
holds a computed motion, through which ``forward`` and ``reverse`` chain the steps, and ``sampling`` evaluates it.
``sensitivity`` joins these parts for one motion, ``runs`` makes a CasADi Function of it, and ``differentiable`` holds
``motion``.  ``reading`` has what sensors read in a motion.
"""
