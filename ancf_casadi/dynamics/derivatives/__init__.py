"""Exact derivatives of a motion with respect to the parameters of the law, the base motion, the elements and the start.

``tangent`` and ``linearised`` linearise a Radau step; ``release_load`` and ``differentiable_start`` the start.  ``run``
holds a computed motion, through which ``forward`` and ``reverse`` chain the steps.  ``sensitivity`` puts these together
for one motion, and ``differentiable`` makes it ``motion``, a CasADi Function, by way of ``runs``.
"""
