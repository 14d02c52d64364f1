"""Frequency matching: element properties within bounds so that the beam has the measured frequencies and shapes.

This is the matching process of Section 5.1, with the results of Tables 9 and 10; the paper states no equation for it.
``frequency_matching`` has ``match_frequencies``, and names the modules of its steps.
"""
