"""Modal parameters from measured frequency response functions.

``record`` holds the measured functions, ``modal_sum`` the model, ``poles`` finds starting values, ``weights`` estimates
the noise, ``refinement`` fits all parameters, ``selection`` decides on the number of modes, and ``fitting`` joins them.
"""
