"""Block elimination along the beam, compared with dense matrices."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, Model, Pin, Roller, static_equilibrium
from ancf_casadi.dynamics.equations import as_they_are
from ancf_casadi.dynamics.radau.link import VALUES
from ancf_casadi.dynamics.radau.links import Links
from ancf_casadi.dynamics.radau.tableau import RADAU
from ancf_casadi.mechanics.nodes import NODE

BEAM = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
SPECIAL = {"clamp_stiffness": 0.5, "tip_mass": 0.002}
SLIDING = {"axis": (1.0, 0.0), "supports": [Pin(0.0), Roller(0.5, (0.8, 0.6))]}
REAL, COMPLEX = 40.0, 30.0 + 35.0j  # s of both systems


def stage_by_stage(columns):
    """Return the numbers of both systems (4 links, 3) from columns (12, links)."""
    return cs.horzcat(*(cs.vec(part) for part in cs.vertsplit(columns, NODE)))


def entries(model, name, *vectors):
    """Return the entries of all element matrices, as in ``Model.entries``."""
    properties = cs.DM(model.properties)
    blocks = [
        getattr(group.element, name).map(group.count)(*map(group.gather, vectors), group.properties(properties))
        for group in model.groups
    ]
    return cs.MX(cs.evalf(cs.vertcat(*map(cs.vec, blocks))))


@pytest.mark.parametrize(
    ("elements", "more"),
    [(2, {}), (6, SPECIAL), (23, {}), (12, SLIDING)],
    ids=["two", "special", "three calls", "oblique roller"],
)
def test_solutions_are_those_of_the_dense_matrices(elements, more):
    """Solve with s^2 M + K."""
    model = Model(Beam.uniform(**BEAM, **more, elements=elements))
    links, rest, N = Links(model, as_they_are, 0), static_equilibrium(model), model.whole_of_free.full()
    K = model.tangent_stiffness(rest.coordinates, model.properties).full()
    M = model.mass(model.properties).full()

    k, m = entries(model, "tangent_stiffness", cs.MX(cs.DM(rest.coordinates))), entries(model, "mass")
    rates = cs.MX(cs.DM([REAL, COMPLEX.real, COMPLEX.imag]))
    outer, inner = links.factors(links.matrices(k, unit=1.0), links.matrices(0 * k), links.matrices(m), rates)
    right = np.random.default_rng(0).normal(size=(model.size, 3)) / model.scale[:, None]

    on_links = cs.MX.zeros(2 * VALUES, links.count)
    on_nodes = links.node_by_node(cs.MX(cs.DM(right @ RADAU.transform.T)))[:, 1:]
    no_turns = cs.MX(cs.DM(np.tile([[1.0], [0.0]], (VALUES // 2, links.count))))
    undamped = cs.MX(0, 3), cs.MX.zeros(3 * NODE, 3), (cs.MX(0, 1), cs.MX(0, links.count))
    columns = links.substitute(links.reduce(on_links, on_nodes, no_turns, outer, *undamped), inner)
    solutions = cs.evalf(stage_by_stage(columns)).full()[model.first_moved - NODE]

    scale, right = model.free_scale, N.T @ right
    parts = [1.0, 1.0j]
    pairs = (REAL, solutions[:, 0], right[:, 0]), (COMPLEX, solutions[:, 1:] @ parts, right[:, 1:] @ parts)
    for s, solution, side in pairs:
        expected = np.linalg.solve(N.T @ (s**2 * M + K) @ N, side)
        assert abs((solution - expected) / scale).max() < 1e-9 * (abs(expected) / scale).max()
