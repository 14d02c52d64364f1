"""Radau IIA collocation of order 5 for the equation of motion.

``tableau`` has the coefficients of the method, ``collocation`` the Functions of a step, ``corotation`` the prediction
of rotations, and ``stepper`` takes the steps.
"""
