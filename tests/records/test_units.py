"""Units as people write them."""

from time import process_time

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.units import known_unit, mass_factor, names_time, parse_unit, unit_in_name


@pytest.mark.parametrize(
    ("text", "quantity", "factor"),
    [
        ("ms", "time", 1e-3), ("Sek", "time", 1.0), ("µs", "time", 1e-6), ("min", "time", 60.0),
        ("mm", "length", 1e-3), ("μm", "length", 1e-6), ("um", "length", 1e-6), ("in", "length", 0.0254),
        ("m/s", "velocity", 1.0), ("mm s^-1", "velocity", 1e-3), ("cm/s", "velocity", 1e-2),
        ("m/s^2", "acceleration", 1.0), ("m/s²", "acceleration", 1.0), ("m·s⁻²", "acceleration", 1.0),
        ("m/s/s", "acceleration", 1.0), ("in/s^2", "acceleration", 0.0254), ("g", "acceleration", 9.80665),
        ("mg", "acceleration", 9.80665e-3), ("deg", "angle", np.pi / 180), ("°", "angle", np.pi / 180),
        ("º", "angle", np.pi / 180), ("Grad", "angle", np.pi / 180), ("gon", "angle", np.pi / 200),
        ("µϵ", "strain", 1e-6), ("N•m", "moment", 1.0),
        ("µε", "strain", 1e-6), ("UM / M", "strain", 1e-6), ("um/m", "strain", 1e-6),
        ("mN", "force", 1e-3), ("kN", "force", 1e3),
        ("N·m", "moment", 1.0), ("N mm", "moment", 1e-3), ("mV", "voltage", 1e-3), ("mm / s", "velocity", 1e-3),
        ("m_s2", "acceleration", 1.0), ("mps2", "acceleration", 1.0), ("ms-2", "acceleration", 1.0),
        ("mm per second per second", "acceleration", 1e-3), ("m per s squared", "acceleration", 1.0),
        ("deg/s", "angular velocity", np.pi / 180), ("rad s-2", "angular acceleration", 1.0), ("1/s", "frequency", 1.0),
    ],
)  # fmt: skip
def test_a_unit_is_understood(text, quantity, factor):
    unit = parse_unit(text)
    assert unit is not None
    assert unit.quantity == quantity
    assert unit.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "foo",
        "NM",
        "nM",
        "NS",
        "mS",
        "Mm",
        "Mg",
        "H",
        "ms2",
        "mm s",
        "m s",
        "m m",
        "mm/g",
        "V/(m/s^2)",
        "1",
        "x",
        "m/s3",
        "/s",
        "m/",
        "m/s m",
        "s-99",
        "mm2",
        "grad",
        "GRAD",
    ],
)
def test_anything_else_is_not(text):
    assert parse_unit(text) is None


@pytest.mark.parametrize(
    ("name", "symbol", "factor"),
    [
        ("Time (ms)", "ms", 1e-3), ("x [mm] raw", "mm", 1e-3), ("tip_mm", "mm", 1e-3), ("x_mm_raw", "mm", 1e-3),
        ("t/ms", "ms", 1e-3), ("s / mm", "mm", 1e-3), ("Weg in mm", "mm", 1e-3), ("Disp, mm", "mm", 1e-3),
        ("v_mm_per_s", "mm_per_s", 1e-3), ("time.ms", "ms", 1e-3), ("ms", "ms", 1e-3), ("m1_x_m", "m", 1.0),
        ("acc m/s²", "m/s²", 1.0), ("acc m / s^2", "m / s^2", 1.0), ("acc m s-2", "m s-2", 1.0),
        ("Beschleunigung a / m/s²", "m/s²", 1.0), ("a in m/s^2", "m/s^2", 1.0),
        ("acc at 250 mm [g]", "g", 9.80665), ("marker_12_mm", "mm", 1e-3), ("x1 mm", "mm", 1e-3), ("Ch 1 V", "V", 1.0),
        ("Ch 3 µm/m", "µm/m", 1e-6), ("Weg 1 mm", "mm", 1e-3), ("Force 1 N", "N", 1.0), ("Acc 2 g", "g", 9.80665),
        ("Velocity 1 m/s", "m/s", 1.0),
        ("ch100_mm", "mm", 1e-3), ("Winkel [Grad]", "Grad", np.pi / 180), ("Phase Grad", "Grad", np.pi / 180),
    ],
)  # fmt: skip
def test_a_name_carries_its_unit(name, symbol, factor):
    shown, unit = unit_in_name(name)
    assert shown == symbol
    assert unit is not None
    assert unit.factor == factor


@pytest.mark.parametrize(
    ("name", "symbol"),
    [
        ("Disp [foo]", "foo"), ("v (mm/foo)", "mm/foo"), ("y(t)", "t"), ("acc_ms2", "ms2"), ("acc_m_s_2", "m_s_2"),
        ("acc_m_s_-2", "m_s_-2"), ("jerk_m_s3", "m_s3"), ("acc_mps3", "mps3"), ("x_mm_per_rev", "mm_per_rev"),
        ("counts_per_mm", "counts_per_mm"), ("F N/mm", "N/mm"), ("force_N_m", "N_m"), ("v m s", "m s"),
        ("area_mm2", "mm2"), ("curvature_m-1", "m-1"), ("eps_um_m", "um_m"), ("x_mm_min", "mm_min"),
        ("x_mm_y_mm", "mm_y_mm"), ("acc [m/s^3", "[m/s^3"), ("a m/s s", "m/s s"),
        ("winkel_grad", "grad"), ("Winkel [grad]", "grad"),
        ("acc at 250 mm", "250 mm"), ("v laser @ 400 mm", "400 mm"), ("Force at 0.4 m", "4 m"), ("x, 20 g", "20 g"),
        ("x at 5 mm", "5 mm"), ("pos_250_mm_acc", "250_mm"), ("x_0.4_m", "4_m"), ("x at 250 mm, mm", "250 mm, mm"),
    ],
)  # fmt: skip
def test_a_unit_that_is_not_certain_is_kept_as_text(name, symbol):
    assert unit_in_name(name) == (symbol, None)


@pytest.mark.parametrize(
    ("quantity", "factor", "names"),
    [
        (
            "acceleration", 1.0,
            "acc_m_s2 acc_mps2 acc_ms-2 acc_m_s-2 acc_m_per_s2 acc_m/s2 acc_m/s² acc_m.s-2 acc_m·s⁻² acc_m_s^2 "
            "acc_m_s**2 acc_m_s_s acc_m_per_s_per_s acc_m_per_s_squared acc_meters_per_second_squared acc_mpers2 "
            "acc_M_S2 m_s2 acc_m_s2_raw acc_m_s2_1 acc(m/s^2)",
        ),
        ("acceleration", 1e-3, "acc_mm_s2 tip_x_mm/s^2 acc_mmps2 acc_mm_per_s2"),
        ("acceleration", 9.80665, "acc_g acc[g] tip_1_g"),
        ("velocity", 1.0, "v_m_s v_m/s v_mps v_m_s-1 v_ms-1 v_m_s_raw x_in_m_s"),
        ("velocity", 1e-3, "v_mm_s v_mm/s v_mm_per_s x_mm_s v_mmps"),
        ("velocity", 0.0254, "v_in_per_s v_in/s"),
        ("angular velocity", np.pi / 180, "w_deg_s w_deg/s w_dps w_deg_per_s w_degs-1"),
        ("angular velocity", 1.0, "w_rad_s w_rad_s-1 w_rads-1 w_radps"),
        ("strain", 1e-6, "e_ustrain strain_ue eps_um/m"),
        ("length", 1.0, "marker_1_m m1_x_m h/m"),
        ("length", 1e-3, "x_mm_2 x_mm.1 arc_s_mm tip_h_mm s/mm upper_mm"),
        ("time", 1.0, "t_in_s time_s"),
        ("pressure", 1e3, "p_kPa"),
    ],
)  # fmt: skip
def test_each_spelling_in_a_name_means_the_same_unit(quantity, factor, names):
    for name in names.split():
        _, unit = unit_in_name(name)
        assert unit is not None, name
        assert (unit.quantity, unit.factor) == (quantity, pytest.approx(factor, rel=1e-12)), name


@pytest.mark.parametrize("pattern", ["m ", "m_", " ", ".", "/", "(", "per_", "mm2_", "a_", "1"])
def test_the_time_to_find_a_unit_grows_with_the_length_of_the_name(pattern):
    """Twice the length takes at most about twice the time; eight times shows a quadratic pattern clearly."""
    times = []
    for size in (4_000, 32_000):
        name = "a" + pattern * (size // len(pattern)) + "b"
        start = process_time()
        unit_in_name(name), names_time(name)
        times.append(process_time() - start)
    assert times[1] < 24 * max(times[0], 1e-3)


@pytest.mark.parametrize("name", "x tip marker_left g in h x_min_value tip_x m2_x tip_m2 x_gps upper_x".split())
def test_a_name_without_a_unit_has_none(name):
    assert unit_in_name(name) == unit_in_name("") == unit_in_name("Tip - 1 x") == ("", None)


def test_an_argument_may_scale_a_unit():
    assert known_unit("0.25 mm", "unit").factor == pytest.approx(0.25e-3)
    assert known_unit("-1 m/s^2", "unit").factor == -1.0
    for text in ("0 mm", "mm 3", "1e400 m", 3, "3"):
        with pytest.raises(InputError, match=r"unit: .* is not a known unit; write for example mm"):
            known_unit(text, "unit")


def test_the_g_of_a_mass_is_a_gram():
    masses = {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "µg": 1e-9, "0.5 g": 5e-4, "20 kg": 20.0}
    for text, factor in masses.items():
        assert mass_factor(known_unit(text, "unit")) == pytest.approx(factor), text
    for text in ("mm", "m/s^2", "g0", "N"):
        with pytest.raises(InputError, match="not of mass"):
            mass_factor(known_unit(text, "unit"))
