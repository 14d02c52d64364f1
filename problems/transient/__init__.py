"""Fits of damping laws and beam properties to large motion of the nonlinear beam.

``motion_record`` holds the measurements of any sensors, and ``marker_record`` those of a camera; ``weights`` makes
their residuals comparable.  ``unknowns`` lists the quantities to estimate, ``problem`` has the residuals, and
``determination`` the combinations that the records leave open.  ``fitting`` has ``fit_transient``, and ``tolerance``
selects the tolerance of its integration.  ``result`` and ``figures`` show the estimates, and
``prediction`` applies them to other records.
"""
