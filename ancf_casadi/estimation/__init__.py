"""Estimation by nonlinear programs with bounds, and the uncertainty of its results.

``nlp`` solves least-squares problems with IPOPT, ``fit`` gives standard errors and intervals from their solution,
``profile`` the intervals from the loss itself, ``autocorrelation`` and ``criteria`` what the residuals tell.
"""
