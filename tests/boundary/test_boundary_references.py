"""The toolkit against the reference cases, the page that compares them, and convergence for each support."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from ancf_casadi import Clamp, Guide, Pin, Roller
from tests.boundary.cases import CASES, HEADER, PAGE, REFERENCES
from tests.boundary.frequencies import omegas
from tests.boundary.statics import FEET, RISE
from tests.boundary.unit_beam import unit_beam

ROWS = PAGE.read_text().partition(HEADER)[2].splitlines()
MARKED = [pytest.param(case, id=case.name, marks=[pytest.mark.slow] * case.slow) for case in CASES]


def numbers(cell):
    return np.array([float(text) for text in cell.split(",")])


@pytest.mark.parametrize("case", MARKED)
def test_the_reference_is_met_and_the_page_shows_it(case):
    """The page may differ by rounding: by a hundredth of the allowed difference."""
    page = [row.strip("| ").split(" | ") for row in ROWS if row.startswith(f"| {case.name} |")]
    assert len(page) == len(case.rows)
    for (label, exact, computed, difference), row in zip(case.rows, page, strict=True):
        assert difference <= case.limit, (label, exact, computed)
        name, at, shown_exact, shown_computed, shown_difference, elements = row
        assert (name, at.strip(), int(elements)) == (case.name, label, case.elements)
        scale = np.maximum(abs(exact), case.size)
        assert (abs(numbers(shown_exact) - exact) <= 1e-6 * scale + 1e-8).all()
        assert (abs(numbers(shown_computed) - computed) <= 1e-2 * case.limit * scale + 1e-8).all()
        assert float(shown_difference) <= case.limit


def test_the_page_has_all_cases_and_no_others():
    names = [re.match(r"\| (\w+) \|", row)[1] for row in ROWS]
    assert list(dict.fromkeys(names)) == [case.name for case in CASES]
    assert {*names} == {*REFERENCES}


def test_the_frame_of_williams_by_shooting():
    """E A e = H cos + V sin, E I theta'' = (1 + e)(H sin - V cos) from foot to apex, without this toolkit."""
    length, angle, guess = np.hypot(FEET, RISE), np.arctan2(RISE, FEET), np.array([-500.0, -12.0, 0.0])

    def apex(unknowns):
        across, up, moment = unknowns

        def slopes(_, state):
            *_, theta, bent = state
            stretch = 1 + (across * np.cos(theta) + up * np.sin(theta)) / 1.885e6
            shear = stretch * (across * np.sin(theta) - up * np.cos(theta))
            return stretch * np.cos(theta), stretch * np.sin(theta), bent / 9270.0, shear

        return solve_ivp(slopes, (0.0, length), (0.0, 0.0, angle, moment), rtol=1e-10, atol=1e-12).y[:3, -1]

    for k in range(1, 8):
        target = np.array([FEET, RISE - k / 10, angle])
        guess = fsolve(lambda unknowns, there=target: 1e3 * (apex(unknowns) - there), guess, xtol=1e-12)
        assert -2 * guess[1] == pytest.approx(REFERENCES["williams_toggle"]["rows"][f"w = {k / 10}"][0], rel=1e-7)


@pytest.mark.parametrize(
    ("supports", "roots"),
    [
        ((Clamp(0.0), Clamp(1.0)), (4.730040744862704, 7.853204624095838)),
        ((Pin(0.0), Pin(1.0)), (np.pi, 2 * np.pi)),
        ((Clamp(0.0), Roller(1.0)), (3.9266023120479185, 7.068582745628732)),
        ((Clamp(0.0), Guide(1.0, (0.0, 1.0))), (2.3650203724313520, 5.4978039190008355)),
        ((Pin(0.0), Guide(1.0, (0.0, 1.0))), (np.pi / 2, 3 * np.pi / 2)),
        ((), (4.730040744862704, 7.853204624095838)),
    ],
    ids=["clamp", "pin", "roller", "guide", "pin and guide", "free"],
)
def test_frequencies_converge_at_order_four(supports, roots):
    """Cubic elements raise omega^2 by (beta l)^4/720; with E A = 1e6, the rounding of the strains stays far below."""
    exact = np.array(roots) ** 2
    errors = np.array([omegas(unit_beam(n, axial=1e6, supports=supports), 2) / exact - 1 for n in (8, 16, 32)])
    np.testing.assert_allclose(np.diff(np.log2(abs(errors)), axis=0), -4.0, atol=0.15)
    np.testing.assert_allclose(errors[-1], (np.array(roots) / 32) ** 4 / 1440, rtol=0.05)
