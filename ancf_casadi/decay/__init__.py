"""Free decays of one mode: records, their release, closed forms and first guesses.

``closed_forms`` holds the linear decay, Eq. (9), the decay under linear and quadratic damping, Eqs. (26) and (27);
``friction`` adds a third term; ``one_mode`` integrates Eq. (26), ``release`` finds the start of the decay in a
``Measurement``, ``first_guess`` estimates frequency and damping, and ``envelope`` measures damping against amplitude.
"""
