"""Modal parameters from measured frequency response functions.

``record`` holds the measured functions, ``modal_sum`` the model and its fit, ``poles`` finds starting values,
``weights`` estimates the noise, ``selection`` decides on the number of modes, ``refinement`` adds the uncertainty, and
``fitting`` joins them.
"""
