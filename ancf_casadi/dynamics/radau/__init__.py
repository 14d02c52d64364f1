"""Radau IIA collocation of order 5 for the equation of motion.

``collocation`` holds the coefficients of the method and the Functions of a step, ``corotation`` the coordinates that
turn with the beam, and ``elimination`` the solution of linear systems.  ``stepper`` takes the steps: ``newton`` solves
the stage equations and chooses the step length.  The reference stands in ``collocation``.
"""
