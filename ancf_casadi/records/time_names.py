"""Names that people give to columns of times."""

from __future__ import annotations

import re

from ancf_casadi.records.unit_names import unit_in_name

TIME_NAMES = re.compile(
    r"(?:elapsed|relative|rel\.?|abs\.?|absolute|sample|test|run|local|system)?[ _]*"
    r"(?:t|times?|zeit|temps|tiempo|tempo|tid|tijd|aika|time[ _-]?stamps?|date[ _/-]?time|uhrzeit|messzeit|"
    r"seconds|secs?|milliseconds|x_value)",
    re.IGNORECASE,
)
BEFORE_UNIT = re.compile(r" ?[(\[{</,]| in |[_ ](?=[^_ ]*$)")


def names_time(name: str) -> bool:
    """Return whether the name of a column, without its unit, is one for times."""
    single = " ".join(name.split())
    bare = BEFORE_UNIT.split(single, maxsplit=1)[0] if unit_in_name(name)[0] else single
    return TIME_NAMES.fullmatch(bare) is not None
