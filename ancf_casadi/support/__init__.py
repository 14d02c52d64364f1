"""Services without mechanics, on which all other folders rest.

``inputs`` checks arguments, ``files`` reads and writes files, ``tables`` displays objects and results, ``figures`` has
colours and texts of figures, ``arrays`` names the array types and the blocks of a vector, ``banded`` stores and
factorises banded matrices, and ``tall`` those with many more rows than columns.  ``compilation`` compiles CasADi
Functions, ``parallel`` runs tasks in processes, ``interrupts`` handles Ctrl-C, ``lazy`` imports public names on first
use, and ``optional`` libraries that may be missing.
"""
