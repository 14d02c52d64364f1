"""Frequency matching: element properties within bounds so that the beam has the measured frequencies and shapes.

This is the matching process of Section 5.1, with the results of Tables 9 and 10; the paper states no equation for it.
``measured_modes`` holds the targets, ``unknowns`` and ``design_space`` the properties that may change, ``preference``
what selects one of many beams, and ``response`` the residuals.  ``program`` has the nonlinear programs,
``frequency_matching`` has ``match_frequencies``, and ``identifiability`` and ``result`` say what the data determine.
"""
