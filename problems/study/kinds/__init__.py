"""The kinds of parts of a study, one file each.

Each file holds the frozen dataclass of a part, its tasks, the tables and figures of its finding, and ``read``, which
makes the part from its table in a TOML file.
"""
