"""Fits of free decays: one mode, several modes at once, and the comparison of damping laws.

``laws`` states the laws, Eqs. (9), (27), as estimation problems, ``starting_values`` gives their starting values, and
``solution`` solves them.  ``fitting`` has ``fit_decay``, Eq. (10); ``mode_separation`` has ``fit_modes``, and
``comparison`` has ``compare_decay_laws``.
"""
