"""Fits of damping laws and beam properties to large motion of the nonlinear beam, and the comparison of laws.

``marker_record`` holds the measurement, ``unknowns`` the quantities to estimate, ``problem`` the residuals, and
``fitting`` has ``fit_transient``, whose integration follows ``tolerance``.  ``result`` and ``figures`` show the
estimates, and ``comparison`` has ``compare_laws``.
"""
