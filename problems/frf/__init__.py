"""Modal parameters from measured frequency response functions.

``record`` holds the measured functions, ``modal_sum`` the model and its fit, ``weights`` estimates the noise,
``selection`` finds starting values and decides on the number of modes, ``refinement`` adds the uncertainty, and
``fitting`` joins them.
"""
