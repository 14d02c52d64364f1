"""Free decays of one mode: their release, closed forms and first guesses.

``closed_forms`` has the slow flow of amplitude and phase, the linear decay, Eq.  (9), and the decay under linear and
quadratic damping, Eqs.  (26) and (27), or a force with a free exponent; ``friction`` adds a third term.
``release`` detects the start of the decay in a ``Measurement`` at any times, ``spectrum`` has its frequencies,
``first_guess`` estimates frequency and damping, ``track`` follows amplitude and phase and fits a short piece without a
law, and ``envelope`` measures damping against amplitude.  ``evidence`` has the statistic by which they decide.
"""
