"""SI prefixes of axes."""

import pytest

from ancf_casadi.support.prefixes import prefixed


@pytest.mark.parametrize(
    ("largest", "unit", "expected"),
    [
        (0.02, "m", (1e-3, "mm")),
        (3e-5, "m", (1e-6, "µm")),
        (12.0, "m/s^2", (1.0, "m/s²")),
        (4e-4, "", (1e-6, "1e-6")),
        (0.0, "m", (1.0, "m")),
        (1.0, "N", (1.0, "N")),
    ],
)
def test_a_value_is_between_1_and_1000_in_the_unit_with_its_prefix(largest, unit, expected):
    size, name = prefixed(largest, unit)
    assert (pytest.approx(size), name) == expected
