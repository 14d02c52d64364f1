"""Free decays of one mode: their release, closed forms and first guesses.

``closed_forms`` has the linear decay, Eq. (9), and the amplitude under linear and quadratic damping, Eqs. (26), (27),
friction, or a force with a free exponent; ``phase`` has the phase if the frequency depends on it.  ``release`` detects
the start of the decay in a ``Measurement`` at any times, ``spectrum`` has its frequencies, ``first_guess`` estimates
frequency and damping, ``track`` follows an oscillation, ``local_decay`` fits a short segment without a damping law, and
``envelope`` measures damping against amplitude.  ``bic`` has the statistic by which they decide.
"""
