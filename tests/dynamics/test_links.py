"""Corrections and residuals that turn with the beam, and the prediction of a step."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, Model
from ancf_casadi.dynamics.equations import as_they_are
from ancf_casadi.dynamics.radau.elimination import BLOCK
from ancf_casadi.dynamics.radau.link import VALUES
from ancf_casadi.dynamics.radau.links import Links
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.mechanics.nodes import NODE

BEAM = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9, "elements": 6}


@pytest.fixture(params=[{}, {"clamp_stiffness": 0.5}], ids=["rigid clamp", "elastic clamp"])
def model(request):
    return Model(Beam.uniform(**BEAM, **request.param))


def stage_by_stage(columns):
    """Return the values at the stages (4 links, 3) from columns (12, links)."""
    return cs.horzcat(*(cs.vec(part) for part in cs.vertsplit(columns, NODE)))


def bent(model, curvature, turn=0.0):
    """Return the coordinates of the beam bent to an arc; the clamped node stays in place, and all behind it turns."""
    arc = np.linspace(0.0, BEAM["length"], BEAM["elements"] + 1)
    angle = turn - np.pi / 2 + curvature * arc
    x = (np.sin(angle) - np.sin(angle[0])) / curvature
    y = (np.cos(angle[0]) - np.cos(angle)) / curvature
    nodes = np.column_stack([x, y, np.cos(angle), np.sin(angle)])
    base = [0.0, 0.0, np.cos(angle[0]), np.sin(angle[0])]
    return np.vstack([*[base] * model.root, *nodes]).ravel()


def transfer(model, reference, other):
    """Return X, (N, N), and the matrix that turns residuals back, both at the middle stage."""
    links, free = Links(model, as_they_are), model.freedoms
    first, e, vector = (cs.MX.sym(name, size) for name, size in zip("rex", (model.size, model.size, free), strict=True))
    none, base = cs.MX.zeros(VALUES, links.count), cs.vertcat(cs.repmat(e[:NODE], 1, STAGES), cs.MX.zeros(8, STAGES))
    state = none, model.of_free(e), cs.MX.zeros(free), cs.MX(1.0), base, cs.reshape(first, NODE, -1)
    _, turns, *_ = links.advance(none, none, *state)

    corrections = (
        cs.vec(links.places(vector)) @ cs.DM(np.linalg.inv(RADAU.transform).sum(axis=1)).T
    )  # alike at all stages
    turned_forth = -stage_by_stage(links.advance(links.node_by_node(corrections), turns, *state)[0])
    residuals = links.node_by_node(cs.repmat(model.moved(vector), 1, STAGES))[:, 1:]
    nothing = cs.MX.zeros(2 * VALUES, links.count), cs.MX.zeros(3 * BLOCK, links.count)  # no forces, no elimination
    turned_back = stage_by_stage(links.reduce(nothing[0], residuals, turns, nothing[1])) @ cs.DM(RADAU.transform).T
    places = (model.first_moved - NODE).tolist()
    outputs = [links.free(cs.reshape(turned_forth[:, 1], NODE, -1)), turned_back[places, 1]]
    both = cs.Function("both", [first, e, vector], outputs)
    columns = [both(reference, other, unit) for unit in np.eye(free)]
    return tuple(np.hstack([column[k].full() for column in columns]) for k in range(2))


def test_residuals_turn_by_the_transpose(model):
    """Residuals do the same work on corrections in both configurations."""
    forth, back = transfer(model, bent(model, 1.0), bent(model, 2.5, 0.3))
    np.testing.assert_allclose(back, forth.T, atol=1e-12)


def test_a_rigid_turn_turns_all_corrections(model):
    """If the whole beam turns, clamp included, all corrections turn by the same angle."""
    angle = 0.7
    forth, _ = transfer(model, bent(model, 1.0), bent(model, 1.0, angle))
    c, s = np.cos(angle), np.sin(angle)
    expected = np.kron(np.eye(model.freedoms // 2), [[c, -s], [s, c]])
    np.testing.assert_allclose(forth, expected, atol=1e-12)


def test_axial_stiffness_is_the_same_after_turning():
    """After turning, X^T K X and K differ by bending alone, a thousand times less than before."""
    model = Model(Beam.uniform(**BEAM))
    reference, other = bent(model, 1.0), bent(model, 2.5)
    stiffness = [model.tangent_stiffness(e, model.properties).full()[NODE:, NODE:] for e in (reference, other)]
    forth, _ = transfer(model, reference, other)
    before = np.abs(stiffness[1] - stiffness[0]).max()
    after = np.abs(forth.T @ stiffness[1] @ forth - stiffness[0]).max()
    assert after < 1e-3 * before


def test_continuing_a_steady_bending(model):
    """A beam that bends to arcs of linearly growing curvature about a turning clamp is continued exactly."""
    times = np.array([0.0, 0.3, 0.6, 1.0])
    motion = np.column_stack([bent(model, 1.0 + t, 0.2 * t) for t in times])
    ahead = np.array([1.2, 1.5, 2.0])
    polynomials = [
        [np.prod([(t - other) / (node - other) for other in times if other != node]) for t in ahead]
        for node in times[1:]
    ]
    expected = np.column_stack([bent(model, 1.0 + t, 0.2 * t) for t in ahead])
    base = np.vstack([expected[:NODE], np.zeros((2 * NODE, STAGES))])
    by_node = motion.T.reshape(times.size, -1, NODE).transpose(1, 0, 2).reshape(-1, times.size * NODE).T
    links = Links(model, as_they_are)
    arguments = (cs.MX(cs.DM(np.asarray(values))) for values in (by_node, polynomials, base))
    increments = stage_by_stage(links.extrapolate(*arguments))
    found = cs.evalf(increments).full() + motion[NODE:, [-1]]
    still = np.abs(motion[NODE:, [-1]] - expected[NODE:]).max()
    assert np.abs(model.of_free(np.vstack([expected[:NODE], found]) - expected)).max() < 1e-4 * still
