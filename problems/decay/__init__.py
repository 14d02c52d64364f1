"""Fits of free decays: one mode, several modes at once, and the comparison of damping laws.

``fitting`` holds ``fit_decay`` (Eqs. 9, 26, 27), ``proportional`` the fit of alpha and beta to measured damping ratios,
Eq. (16).
"""
