"""The keys of a study file, as ``ancf-casadi study --help`` lists them."""

from __future__ import annotations

from problems.study.kinds import (
    amplitudes,
    beam,
    comparison,
    decays,
    drawings,
    integrators,
    matching,
    modes,
    motion,
    omitted,
    rayleigh,
    shapes,
    simulation,
    transients,
)
from problems.study.kinds.drag import change, combined, effects
from problems.tables import beam as beam_table
from problems.tables import damping, match

STUDY_KEYS = f"""\
tables of a TOML file:
  [study]       title, text, source (a reference), printed_by (origin of printed
                numbers), seed
{beam_table.KEYS}{match.KEYS}\
  [[decays]]    measured free decays, one per mode: file, column, unit, time,
                time_unit, rate, from, to, release_time
  [[laws]]      damping laws: name, title, terms = [{{law = "modal", ...}}, ...] with
                the keys of [[damping]], or terms = [{{part = "PART"}}]
{damping.KEYS}\
  [[parts]]     the document in order; without it, the parts that the other tables
                suggest.  Each part has a kind and may have a name (its key in
                results.json), title, text, section, notes, and the labels of its
                tables and figures
{beam.KEYS}{modes.KEYS}{decays.KEYS}{rayleigh.KEYS}{matching.KEYS}{transients.KEYS}\
{amplitudes.KEYS}{shapes.KEYS}{integrators.KEYS}{effects.KEYS}{change.KEYS}{combined.KEYS}{drawings.KEYS}\
{simulation.KEYS}{motion.KEYS}{comparison.KEYS}{omitted.KEYS}"""
