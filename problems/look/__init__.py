"""A page in the browser that shows records and fits them while the user chooses: ``ancf-casadi look``.

``choices`` holds what the user has chosen, as the command and the study that do the same; ``computation`` reads and
fits with the public functions, in the thread of ``worker``; ``charts`` lays the results out; ``record_page`` and
``takes`` show decays, with what panels have in common in ``widgets``.  ``frf``, ``frf_charts`` and ``frf_page`` do all
this for frequency response functions, ``film`` and ``film_page`` for films, ``beam``, ``beam_computation`` and
``beam_charts`` for a study with a beam, whose ``form`` is made from the declarations of its tables, and whose text
``editing`` changes.  ``page`` chooses the panel for files, and ``server`` keeps the page to this machine.
"""
