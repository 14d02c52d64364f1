"""Properties of a beam from static tests and natural frequencies, in one fit over several configurations.

``records`` holds load-deflection tables and frequencies, ``observation`` the readings of sensors at rest, and
``response`` the computed values with exact derivatives.  ``quantities`` names the unknowns, and ``fitting`` has
``fit_properties``.  ``determined`` states which combinations the records determine, ``result`` holds the estimates,
``prediction`` the values of any record computed with them, and ``figures`` draws these.
"""
