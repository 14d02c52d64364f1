"""Studies: a TOML file becomes tables, figures, ``results.json`` and one HTML document.

``study`` is the entry.  ``reading`` makes the parts of a study from its file, one kind of part per file in ``kinds``;
``runner`` runs them and keeps every finished computation (``store``); ``document`` writes the page.  ``paper.toml`` is
the study of the paper.
"""
