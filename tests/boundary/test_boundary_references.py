"""The toolkit against the reference cases, the page that compares them, and convergence for each support."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from tests.boundary import statics
from tests.boundary.cases import CASES, HEADER, PAGE, REFERENCES, summary
from tests.boundary.convergence import HELD, MESHES, errors, order
from tests.boundary.statics import FEET, RISE

ROWS = PAGE.read_text().partition(HEADER)[2].splitlines()
MARKED = [pytest.param(case, id=case.name, marks=[pytest.mark.slow] * case.slow) for case in CASES]


def numbers(cell):
    return np.array([float(text) for text in cell.split(",")])


@pytest.mark.filterwarnings("ignore:an element bends")  # in the fold of the rubber pendulum
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

        return solve_ivp(slopes, (0.0, length), (0.0, 0.0, angle, moment), method="DOP853", rtol=1e-10, atol=1e-12).y[
            :3, -1
        ]

    for k in range(1, 8):
        target = np.array([FEET, RISE - k / 10, angle])
        guess = fsolve(lambda unknowns, there=target: 1e3 * (apex(unknowns) - there), guess, xtol=1e-12)
        assert -2 * guess[1] == pytest.approx(REFERENCES["williams_toggle"]["rows"][f"w = {k / 10}"][0], rel=1e-7)


@pytest.mark.parametrize("name", HELD)
def test_frequencies_converge_at_order_four(name):
    """Cubic elements raise omega^2 by (beta l)^4/720; the page shows these errors."""
    found = errors(name)
    assert order(found) == pytest.approx(4.0, abs=0.05)
    assert found[-1] == pytest.approx((HELD[name][1] / MESHES[-1]) ** 4 / 1440, rel=0.05)
    row = next(line for line in PAGE.read_text().splitlines() if line.startswith(f"| {name} | "))
    shown = [float(cell) for cell in row.strip("| ").split(" | ")[1:]]
    assert shown == pytest.approx([*found, order(found)], rel=0.02)


@pytest.mark.parametrize("compute", [statics.dead_tip_force, statics.uniform_follower_load])
def test_large_deflections_converge_at_order_four(compute):
    """The beam stretches by up to 1e-7, which the references do not."""
    exact = np.array([*REFERENCES[compute.__name__]["rows"].values()])
    found = [abs(np.array(compute(n)) - exact).max() for n in MESHES]
    assert order(found) == pytest.approx(4.0, abs=0.2)
    assert found[-1] < 5e-6


def test_the_page_describes_all_cases():
    assert summary() in PAGE.read_text()
