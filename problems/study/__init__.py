"""Studies: a TOML file becomes tables, figures, ``results.json`` and one HTML document.

``study`` is the entry.  ``reading`` makes the steps of a study from its file, of the kinds in ``kinds``.  ``runner``
runs them, and ``compute`` keeps every finished computation.  ``results`` labels what they find, and writes the
document, with tables as ``formatting`` shows them.
"""
