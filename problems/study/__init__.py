"""The study of the paper, from its printed numbers to its tables and figures.

``paper`` holds the printed numbers, ``decays`` the synthetic records behind Tables 2 and 4, ``transients`` the driven
and stopped beam of Table 11.  ``reproduction`` runs all steps; ``tables`` and ``figures`` show Tables 2, 3, 4, 9, 10
and 11, one function each, and ``report`` writes them to files.
"""
