"""The model for other programs: CasADi Functions, C, and what describes them; and its durable form."""

from ancf_casadi.export.document import (
    DataFile,
    Document,
    Identification,
    Provenance,
    read_document,
    schema,
    write_document,
)
from ancf_casadi.export.fmu import write_fmu
from ancf_casadi.export.signals import Signal

__all__ = [
    "DataFile",
    "Document",
    "Identification",
    "Provenance",
    "Signal",
    "read_document",
    "schema",
    "write_document",
    "write_fmu",
]
