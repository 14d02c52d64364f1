"""A page in the browser that shows records and fits their decays while the user chooses: ``ancf-casadi look``.

``choices`` holds what the user has chosen, as the command and the study that do the same; ``computation`` reads and
fits with the public functions; ``charts`` lays the results out; ``page`` and ``takes`` show them, with what panels have
in common in ``widgets``; and ``server`` keeps the page to this machine.
"""
