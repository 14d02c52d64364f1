"""Free decays of one mode: their release, closed forms and first guesses.

``closed_forms`` has the linear decay, Eq. (9), and the decay under linear and quadratic damping, Eqs. (26) and (27);
``friction`` adds a third term; ``one_mode`` integrates Eq. (26).  ``release`` detects the start of the decay in a
``Measurement``, ``first_guess`` estimates frequency and damping, and ``envelope`` measures damping against amplitude.
"""
