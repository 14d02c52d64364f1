"""The tables of TOML files.

``table.StudyFile`` is a file that was read.  A table whose keys are the arguments of a class or a function, such as
``HarmonicBase``, is declared by its signature (``table.made``).  A table with keys of its own is declared by a class
whose fields carry type, range, default and description (``table.read``), which gives the checks and the help.

Keys are strict, and each error begins with ``FILE: [table]: key``.  Names of other files are relative to the folder of
the TOML file.
"""
