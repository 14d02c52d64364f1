"""The model for other programs: CasADi Functions, C, and what describes them."""

from ancf_casadi.export.signals import Signal

__all__ = ["Signal"]
