"""Damping laws take energy out of bent and buckled beams; the tangent stiffness may add energy, with a warning."""

import warnings

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import ModalDamping, Model, QuadraticDamping, RayleighDamping, State, natural_modes, simulate

LENGTH = 0.9  # m; the strip stands up to (7.837 E I/(mu g))^(1/3) = 0.759 m by itself
BOTH = pytest.mark.parametrize("method", ["idas", "radau"])


def reference(beta):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return RayleighDamping(beta=beta, stiffness="reference")


DISSIPATIVE = {
    "mass": lambda modes: RayleighDamping(alpha=0.5),
    "strain-rate": lambda modes: RayleighDamping(beta=3e-3),
    "reference": lambda modes: reference(3e-5),
    "quadratic": lambda modes: QuadraticDamping(eta1=0.2, eta2=1.0),
    "generic": lambda modes: ModalDamping(modes, (0.05, 0.02)),
    "sum": lambda modes: RayleighDamping(0.1, 1e-3) + QuadraticDamping(eta2=0.5) + ModalDamping(modes, (0.05, 0.02)),
}
TANGENT = RayleighDamping(beta=3e-3, stiffness="tangent")


@pytest.fixture(scope="module")
def standing(rubber_beam):
    """A standing strip, too long for its stiffness."""
    return Model(rubber_beam(5, length=LENGTH, axis=(0.0, 1.0)))


@pytest.fixture(scope="module")
def modes(rubber_beam):
    """Modes of the strip without gravity."""
    return natural_modes(Model(rubber_beam(5, length=LENGTH, axis=(0.0, 1.0), gravity=(0.0, 0.0))), count=2)


def arc(model, angle):
    """Coordinates of a standing beam bent to a circular arc with the given end angle."""
    s = np.linspace(0.0, LENGTH, model.beam.elements + 1)
    theta, radius = angle * s / LENGTH, LENGTH / angle
    nodes = [radius * (1 - np.cos(theta)), radius * np.sin(theta), np.sin(theta), np.cos(theta)]
    return np.array(nodes).T.ravel()


def fallen(model, law, method, **settings):
    """Motion of the strip that buckles from almost upright, falls, and bends."""
    start = State(arc(model, 0.02), np.zeros(model.size))
    return simulate(model, damping=law, start=start, duration=2.0, sample_rate=100.0, method=method, **settings)


def least_power(law, model, e):
    """Least power lost to damping, for random velocities and along the softest direction of the beam."""
    x, v = cs.MX.sym("e", model.size), cs.MX.sym("e_t", model.size)
    power = cs.Function("power", [x, v], [cs.dot(v, law.force(model, x, v))])
    free = slice(4, model.size)
    vectors = np.linalg.eigh(model.tangent_stiffness(e, model.properties).full()[free, free])[1]
    speeds = np.vstack([np.random.default_rng(0).normal(size=(20, model.size)), np.zeros((2, model.size))])
    speeds[-2:, free] = vectors[:, :2].T
    return min(float(power(e, speed)) for speed in speeds)


@pytest.mark.parametrize("law", DISSIPATIVE.values(), ids=DISSIPATIVE)
@pytest.mark.parametrize("angle", [0.02, 1.5, 3.0], ids=["buckling", "bent", "bent back"])
def test_every_law_but_the_tangent_one_takes_energy_wherever_the_beam_is(standing, modes, law, angle):
    law = law(modes)
    assert law.dissipative
    assert least_power(law, standing, arc(standing, angle)) >= -1e-15


def test_the_tangent_law_adds_energy_along_the_direction_in_which_the_beam_buckles(standing):
    """The stiffness of a compressed strip is indefinite."""
    e = standing.straight.copy()
    e[4:] *= 1 - 5e-4
    assert not TANGENT.dissipative and not (TANGENT + RayleighDamping(alpha=1.0)).dissipative
    assert RayleighDamping(alpha=1.0, stiffness="tangent").dissipative
    assert least_power(TANGENT, standing, e) < -1e-9


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:an element bends")
@BOTH
def test_simulate_warns_where_the_tangent_law_adds_energy(standing, method):
    with pytest.warns(UserWarning, match=r"^damping added \S+ J to the motion from .* use .*'strain-rate'") as caught:
        run = fallen(standing, TANGENT, method)
    caught = [warning for warning in caught if "an element bends" not in str(warning.message)]
    assert len(caught) == 1 and caught[0].filename == __file__
    lost = run.dissipated_energy
    gained = np.max(np.maximum.accumulate(lost) - lost)
    assert gained > 1e-5 and gained > 3 * abs(run.balance_error).max()
    assert f"added {gained:.2g} J" in str(caught[0].message)


@pytest.mark.slow
@BOTH
def test_the_tangent_law_takes_energy_and_draws_no_warning_where_the_beam_is_stable(rubber_beam, method):
    """A hanging strip, whose stiffness is positive."""
    model = Model(rubber_beam(5))
    start = State(model.straight, 0.2 * natural_modes(model, count=1).shapes[:, 0])
    run = simulate(model, damping=TANGENT, start=start, duration=1.0, sample_rate=100.0, method=method)
    assert np.diff(run.dissipated_energy).min() >= 0.0
    assert run.dissipated_energy[-1] > 0.05 * run.kinetic_energy[0]
