"""A part for tables and figures that are not computed, such as photographs: it states the reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import check_keys, located
from problems.study.kind import Kind
from problems.study.part import Effort, Finding, Heading, Outcome, Part
from problems.study.source import Source, text_of

KEYS = """\
  kind = "omitted"      reason: why the labelled tables and figures are not computed
"""


class OmittedNumbers(TypedDict):
    """Labels that are not computed, and the reason."""

    omitted: list[str]
    reason: str


@final
@dataclass(frozen=True)
class Omitted(Part):
    """Tables and figures that are not computed.

    Parameters
    ----------
    reason : str
        The reason.
    """

    kind = "omitted"
    numbers = OmittedNumbers

    reason: str

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the reason."""
        labels = [*self.heading.tables, *self.heading.figures]
        return Finding(Outcome({"omitted": labels, "reason": self.reason}))


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> Omitted:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    """
    check_keys(given, {"reason"}, set(), where)
    with located(where):
        reason = text_of(given, "reason", "")
        if not reason.strip():
            raise InputError("must not be empty; say why the tables and figures are not computed", "reason")
        return Omitted(heading, reason)


KIND = Kind(Omitted.kind, "Not computed", KEYS, read)
