"""The table [beam]: the keys of ``Beam.uniform``, or a JSON document with a beam and its damping."""

from __future__ import annotations

from ancf_casadi.export.document.model_document import Document, read_document
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import located
from problems.tables.study import Study, checked

KEYS = """\
  [beam]        length (m), elements; width, thickness (m), density (kg/m^3),
                elastic_modulus (Pa): each a number, or a list with one value
                per element; optional: axis, gravity (m/s^2), tip_mass (kg),
                clamp_stiffness (N m/rad);
                or only document = "BEAM.json": a JSON document with a beam and
                its damping; a relative path starts at the folder of this file
"""


def read_beam(study: Study) -> Document:
    """Return the beam of a file, with damping if it comes from a document.

    Raises
    ------
    InputError
        If a key or value cannot be used, or the document cannot be read.
    """
    table, where = study.tables["beam"], study.where("beam")
    if isinstance(table, dict) and "document" in table:
        checked(table, {"document"}, set(), where)
        path = study.file(table["document"], f"{where}: document")
        with located(f"{where}: document"):
            return read_document(path)
    return Document(Model(Beam.from_table(table, study.path)))
