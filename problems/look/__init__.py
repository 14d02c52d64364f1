"""A page in the browser that shows a record and fits its decay while the user chooses: ``ancf-casadi look``.

``choices`` holds what the user has chosen, as the command and the study that do the same; ``computation`` reads and
fits with the public functions; ``charts`` lays the results out, ``page`` shows them, and ``server`` keeps the page to
this machine.  ``beam``, ``beam_computation`` and ``beam_charts`` do this for a study with a beam, whose ``form`` is
made from the declarations of its tables.
"""
