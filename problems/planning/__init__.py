"""Planned experiments: the standard errors that candidate records will have, and the lists that are worth measuring."""
