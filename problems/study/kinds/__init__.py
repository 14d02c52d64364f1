"""The kinds of parts of a study, one file each.

Each file holds the frozen dataclass of a part, its tasks, the tables and figures of its finding, ``read``, which makes
the part from its table in a TOML file, and ``KIND``, which names all this.  ``registry`` lists the kinds.
"""
