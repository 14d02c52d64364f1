"""SI prefixes for the axes of figures."""

from __future__ import annotations

import math

PREFIXES = {0: "", -3: "m", -6: "µ", -9: "n", -12: "p", 3: "k", 6: "M"}


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """Return the size and the name of the unit with an SI prefix in which a value is between 1 and 1000.

    A quantity without a unit, such as strain, is in millionths or, if large, as it is.
    """
    if not (math.isfinite(largest) and largest > 0.0):
        return 1.0, unit
    power = 3 * math.floor(math.log10(largest) / 3)
    if not unit:
        return (1e-6, "1e-6") if power < 0 else (1.0, "")
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return 10.0**power, PREFIXES[power] + unit.replace("^2", "²")
