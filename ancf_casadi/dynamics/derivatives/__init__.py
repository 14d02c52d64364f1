"""Exact derivatives of a motion by the parameters of the law, the base motion, the elements and the start.

``tangent`` linearises a Radau step, ``release_load`` the start from a load, ``sensitivity`` chains the steps forwards
and in reverse, and ``differentiable`` holds ``motion``, a CasADi Function with these derivatives.
"""
