"""The kinds of parts of a study.

A kind is a frozen dataclass: its fields are the keys of its table in a TOML file, with type, range and description, and
its methods state its tasks and make the tables and figures of its finding.  ``registry`` lists the kinds.
"""
