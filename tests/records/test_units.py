"""Units as people write them."""

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.units import known_unit, parse_unit, unit_in_name


@pytest.mark.parametrize(
    ("text", "quantity", "factor"),
    [
        ("ms", "time", 1e-3), ("Sek", "time", 1.0), ("µs", "time", 1e-6), ("min", "time", 60.0),
        ("mm", "length", 1e-3), ("μm", "length", 1e-6), ("um", "length", 1e-6), ("in", "length", 0.0254),
        ("m/s", "velocity", 1.0), ("mm s^-1", "velocity", 1e-3), ("cm/s", "velocity", 1e-2),
        ("m/s^2", "acceleration", 1.0), ("m/s²", "acceleration", 1.0), ("m·s⁻²", "acceleration", 1.0),
        ("m/s/s", "acceleration", 1.0), ("in/s^2", "acceleration", 0.0254), ("g", "acceleration", 9.80665),
        ("mg", "acceleration", 9.80665e-3), ("deg", "angle", np.pi / 180), ("°", "angle", np.pi / 180),
        ("µε", "strain", 1e-6), ("um/m", "strain", 1e-6), ("mN", "force", 1e-3), ("kN", "force", 1e3),
        ("N·m", "moment", 1.0), ("N mm", "moment", 1e-3), ("mV", "voltage", 1e-3),
    ],
)  # fmt: skip
def test_a_unit_is_understood(text, quantity, factor):
    unit = parse_unit(text)
    assert unit is not None
    assert unit.quantity == quantity
    assert unit.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("text", ["", "foo", "ms2", "mm s", "mm/g", "V/(m/s^2)", "1", "x"])
def test_anything_else_is_not(text):
    assert parse_unit(text) is None


@pytest.mark.parametrize(
    ("name", "symbol", "factor"),
    [
        ("Time (ms)", "ms", 1e-3), ("x [mm] raw", "mm", 1e-3), ("tip_mm", "mm", 1e-3), ("x_mm_raw", "mm", 1e-3),
        ("t/ms", "ms", 1e-3), ("s / mm", "mm", 1e-3), ("Weg in mm", "mm", 1e-3), ("Disp, mm", "mm", 1e-3),
        ("v_mm_per_s", "mm/s", 1e-3), ("time.ms", "ms", 1e-3), ("ms", "ms", 1e-3), ("m1_x_m", "m", 1.0),
        ("acc m/s²", "m/s²", 1.0),
    ],
)  # fmt: skip
def test_a_name_carries_its_unit(name, symbol, factor):
    found, unit = unit_in_name(name)
    assert found == symbol
    assert unit is not None
    assert unit.factor == factor


@pytest.mark.parametrize("name", ["Disp [foo]", "x_mm_s", "v (mm/foo)", "y(t)"])
def test_a_unit_that_is_not_certain_is_kept_as_text(name):
    symbol, unit = unit_in_name(name)
    assert symbol
    assert unit is None


@pytest.mark.parametrize("name", ["x", "tip", "marker_left", "g", "in", "h", "Tip - 1 x", "x_min_value", ""])
def test_a_name_without_a_unit_has_none(name):
    assert unit_in_name(name) == ("", None)


def test_an_argument_may_scale_a_unit():
    assert known_unit("0.25 mm", "unit").factor == pytest.approx(0.25e-3)
    assert known_unit("-1 m/s^2", "unit").factor == -1.0
    for text in ("0 mm", "mm 3", "1e400 m", 3, "3"):
        with pytest.raises(InputError, match=r"unit: .* is not a known unit; write for example mm"):
            known_unit(text, "unit")
