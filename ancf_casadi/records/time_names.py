"""Names that people give to columns of times."""

from __future__ import annotations

import re

from ancf_casadi.records.units import unit_in_name

NAMES = re.compile(
    r"(?:elapsed|relative|rel\.?|abs\.?|absolute|sample|test|run|local|system)?[ _]*"
    r"(?:t|times?|zeit|temps|tiempo|tempo|tid|tijd|aika|time[ _-]?stamps?|date[ _/-]?time|uhrzeit|messzeit|"
    r"seconds|secs?|milliseconds|x_value)",
    re.IGNORECASE,
)
BEFORE_UNIT = re.compile(r"\s*[(\[{</,]|\s+in\s|[_ ](?=[^_ ]*$)")


def names_time(name: str) -> bool:
    """Return whether the name of a column, without its unit, is one for times."""
    bare = BEFORE_UNIT.split(name.strip())[0] if unit_in_name(name)[0] else name.strip()
    return NAMES.fullmatch(bare) is not None
