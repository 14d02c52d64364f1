"""Frequency matching: element properties within bounds so that the beam has the measured frequencies and shapes.

This is the matching process of Section 5.1, with the results of Tables 9 and 10; the paper states no equation for it.
``measured_modes`` holds the targets, ``unknowns`` and ``design_space`` the properties that may change, ``preference``
the criteria that select one of many beams, and ``response`` the residuals.  ``program`` has the nonlinear programs, and
``frequency_matching`` has ``match_frequencies``.  ``result`` holds the matched beam, and ``identifiability`` the
properties that the data determine.
"""
