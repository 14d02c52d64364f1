"""Formats of the exported Functions: C99, FMU, and CasADi's own files."""
