"""The kinds of parts that users' studies have.

A kind is a frozen dataclass: its fields are the keys of its table in a TOML file, with type, range and description, and
its methods state its tasks and make the tables and figures of its finding.
"""
