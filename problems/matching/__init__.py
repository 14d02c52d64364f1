"""Frequency matching: element properties within bounds so that the beam has the measured frequencies and shapes.

The nonlinear program is Eqs. (31) and (32), in ``problem``; its results are those of Tables 9 and 10.
"""
