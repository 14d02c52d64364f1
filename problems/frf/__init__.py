"""Modal parameters from measured frequency response functions.

``record`` holds the measured functions, ``modal_sum`` the model and its fit.  ``selection`` finds starting values and
decides on the number of modes, ``refinement`` estimates the noise and adds the uncertainty, and ``fitting`` joins them.
"""
