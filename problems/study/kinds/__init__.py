"""The kinds of steps that users' studies have.

A kind is a frozen dataclass: its fields are the keys of its table in a TOML file, with type, range and description, and
its method ``finding`` computes and shows what it is about.
"""
