"""Fits of damping laws and beam properties to large motion of the nonlinear beam, and the comparison of laws.

``marker_record`` holds the measurement, ``unknowns`` the quantities to estimate, and ``problem`` the residuals.
``fitting`` has ``fit_transient``, and ``tolerance`` selects the tolerance of its integration.  ``result`` and
``figures`` show the estimates, and ``comparison`` has ``compare_laws``.
"""
