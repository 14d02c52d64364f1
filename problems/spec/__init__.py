"""The tables of TOML files, each declared once.

A table is a ``Spec``, or a class of the toolkit whose fields are its keys; types, ranges, units and descriptions follow
from the declaration, and with them the checks, the help and the JSON Schema.  ``file.StudyFile`` is a file that was
read.  Names of other files are relative to the folder of the TOML file.

Keys are strict, and each error begins with ``FILE: [table]: key``.
"""
