"""Fits of damping laws and beam properties to measured steady-state vibration, and the comparison of laws.

``record`` holds measured amplitudes and phases against frequency, and ``weights`` makes their residuals comparable.
``driven`` is the reduced beam under a harmonic excitation with a sensor, ``balance`` its harmonic balance, and
``points`` the steady motion closest to a measured point.  ``unknowns`` lists the quantities to estimate, ``problem``
and ``residuals`` have the residuals of curves, and ``joint`` adds those of motions and other evidence.  ``fitting`` has
``fit_response``, with the settings of ``fit_options``.  ``result`` and ``figures`` show the estimates, ``prediction``
applies them to other records, and ``comparison`` has ``compare_laws``, for motions too.
"""
