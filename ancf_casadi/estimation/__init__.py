"""Estimation from any mix of measurements, Eq. (10), and the uncertainty of the estimates.

``block`` is a set of measurements with its physics, ``solve`` the loop that fits a sum of blocks with the means of
``solver``, and ``determination`` finds out whether the data determine the unknowns.  ``fit`` has the estimates and
their standard errors, ``intervals`` intervals to first order and by profile likelihood, ``resampling`` repeated fits;
``agreement`` compares parts of the data, ``criteria`` and ``comparison`` select a law.  ``result`` is what every fit
returns, ``prediction`` what it says of other records, ``saved`` a result from a file; ``figures`` draws them.
"""
