"""Estimation by bounded nonlinear programs, Eq. (10), and the uncertainty of the estimates.

``least_squares`` states a problem, with the ``loss`` of the residuals, ``nlp`` solves it with IPOPT, and ``polish``
refines the solution by Gauss-Newton steps.  ``estimates`` has standard errors and intervals to first order, ``profile``
intervals by profile likelihood, ``resampling`` repeated fits, and ``fit`` the report.  ``noise`` estimates the spectrum
of the residuals, which the standard errors allow for; ``agreement`` compares parts of the data; ``criteria`` and
``comparison`` select a law.  ``result`` is the interface of all results,
and ``figures`` draws them.
"""
