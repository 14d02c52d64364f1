"""The files of each command: which tables it reads, and their keys as ``--help`` lists them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.model_document import Document, read_document
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import StrainMeasures
from problems.tables import base, beam, damping, load, match, records, release, response, simulation
from problems.tables.study import Study, is_document

HEAD = "tables of a TOML file:\n"
BEAM_KEYS = HEAD + beam.KEYS
SOURCE_KEYS = HEAD + beam.KEYS + damping.KEYS
MATCH_KEYS = HEAD + beam.KEYS + match.KEYS
SIMULATION_KEYS = HEAD + beam.KEYS + damping.KEYS + base.KEYS + load.KEYS + release.KEYS + simulation.KEYS
RESPONSE_KEYS = HEAD + beam.KEYS + damping.KEYS + response.KEYS
MOTION_KEYS = HEAD + beam.KEYS + damping.KEYS + base.KEYS + load.KEYS + release.KEYS + records.KEYS


def read_source(path: str) -> Document:
    """Read a beam and its damping from a TOML file, or from a JSON document (a name that ends in ``.json``).

    Raises
    ------
    InputError
        If the file cannot be read, or a table, key or value cannot be used.
    """
    return read_document(path) if is_document(path) else _source(Study.read(path))


def read_model(path: str) -> Model:
    """Read the beam of a file, with its strain measures.

    Raises
    ------
    InputError
        As ``read_source``.
    """
    return read_document(path).model if is_document(path) else beam.read_beam(Study.read(path)).model


def read_match(path: str) -> tuple[Beam, dict[str, Any]]:
    """Read a beam and the arguments of ``match_frequencies``.

    Raises
    ------
    InputError
        As ``read_source``, or if the strain measures of the beam are not those of a match.
    """
    study = Study.read(path)
    model = beam.read_beam(study).model
    if model.measures != StrainMeasures():
        raise InputError(
            "the document has strain measures that a match does not support; use the defaults", study.where("beam")
        )
    if model.beam.elements > match.MOST_ELEMENTS:
        raise InputError(
            f"a match takes {match.MOST_ELEMENTS} at most, got {model.beam.elements}; 20 to 100 are enough",
            f"{study.where('beam')}: elements",
        )
    return model.beam, match.read_request(study)


def read_simulation(path: str) -> simulation.Simulation:
    """Read a beam, its damping, the motion of its base and the settings of the simulation.

    Raises
    ------
    InputError
        As ``read_source``, or if a file that the tables name cannot be read.
    EquilibriumError
        If there is no equilibrium under the load of [release].
    """
    return simulation_of(Study.read(path))


def simulation_of(study: Study) -> simulation.Simulation:
    """Return the simulation in the tables of a file.

    Raises
    ------
    InputError, EquilibriumError
        As ``read_simulation``.
    """
    return simulation.simulation(study, _source(study))


def read_response(path: str) -> response.ResponseTask:
    """Read a beam, its damping, and its harmonic excitation over a range of frequencies.

    Raises
    ------
    InputError
        As ``read_source``.
    """
    return response_of(Study.read(path))


def response_of(study: Study) -> response.ResponseTask:
    """Return the steady vibration in the tables of a file.

    Raises
    ------
    InputError
        As ``read_response``.
    """
    return response.response_task(study, _source(study))


def read_motions(path: str) -> records.Motions:
    """Read a beam, its damping, measured motions, and the unknowns of a fit to them.

    Raises
    ------
    InputError
        As ``read_simulation``, or if there are no records.
    EquilibriumError
        If there is no equilibrium under the load of a release.
    """
    return motions_of(Study.read(path))


def motions_of(study: Study) -> records.Motions:
    """Return the measured motions in the tables of a file.

    Raises
    ------
    InputError, EquilibriumError
        As ``read_motions``.
    """
    return records.motions(study, _source(study))


def _source(study: Study) -> Document:
    """Return the beam of a file with its damping; the damping of a document holds unless the file has its own."""
    source = beam.read_beam(study)
    if "damping" not in study.tables:
        return source
    return replace(source, damping=damping.total(damping.read_terms(study, source.model)))
