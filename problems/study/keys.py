"""The keys of a study file: the help of ``study``, and of ``reproduce`` for kinds of parts that only the paper has."""

from __future__ import annotations

from problems.schema import beam, match
from problems.study.kinds.registry import OF_PAPER, USUAL

STUDY_KEYS = f"""\
{beam.HEAD}\
  [study]       title, text, source (a reference), printed_by (origin of printed
                numbers), seed
{beam.KEYS}{match.KEYS}\
  [[decays]]    measured free decays: file, column, unit, time,
                time_unit, rate, from, to, release_time
  [[laws]]      damping laws: name, title, terms = [{{law = "modal", ...}}, ...] with
                the keys of [[damping]], or terms = [{{part = "PART"}}]
{beam.DAMPING_KEYS}\
  [[parts]]     the document in order; without it, the parts that the other tables
                suggest.  Each part has a kind and may have a name (its key in
                results.json), title, text, section, notes, draw (false: without
                figures), quick (false: not in a quick look), and the labels of its
                tables and figures
{"".join(kind.keys for kind in USUAL)}"""
PAPER_KEYS = f"""\
kinds of [[parts]] that only the study of the paper has:
{"".join(kind.keys for kind in OF_PAPER)}"""
