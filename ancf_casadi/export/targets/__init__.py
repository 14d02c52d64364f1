"""Formats of the exported Functions: C99, FMU, and CasADi's own files.

``c`` writes C code with a header and a test program (``c_source``, ``decay_program``), ``fmu`` an FMU
(``fmu_description``), and ``storage`` files of Functions.
"""
