"""Block elimination along the beam, compared with dense matrices."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, Model, static_equilibrium
from ancf_casadi.dynamics.equations import as_it_is
from ancf_casadi.dynamics.radau.elimination import Elimination, node_blocks, node_places
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.vibration.modes import natural_modes

BEAM = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
SPECIAL = {"clamp_stiffness": 0.5, "tip_mass": 0.002}


@pytest.mark.parametrize("rank", [0, 3])
@pytest.mark.parametrize("s", [40.0 + 0.0j, 30.0 + 35.0j], ids=["real", "complex"])
@pytest.mark.parametrize(("elements", "more"), [(2, {}), (6, SPECIAL), (23, {})], ids=["two", "special", "three calls"])
def test_solution_is_that_of_the_dense_matrix(elements, more, s, rank):
    """Solve with s^2 M + K + s V diag(d) V^T; one mode of the law is undamped, so d has a zero."""
    model = Model(Beam.uniform(**BEAM, **more, elements=elements))
    rest, free, parts = static_equilibrium(model), model.first_moved, 1 + bool(s.imag)
    groups, properties = model.groups, model.properties
    blocks = {name: [getattr(g.element, name).map(g.count) for g in groups] for name in ("tangent_stiffness", "mass")}
    p = [cs.DM(g.properties(cs.DM(properties))) for g in groups]
    e = [g.gather(cs.MX(cs.DM(rest.coordinates))) for g in groups]
    k = cs.evalf(cs.vertcat(*(cs.vec(f(x, y)) for f, x, y in zip(blocks["tangent_stiffness"], e, p, strict=True))))
    m = cs.evalf(cs.vertcat(*(cs.vec(f(y)) for f, y in zip(blocks["mass"], p, strict=True))))
    K = model.tangent_stiffness(rest.coordinates, properties).full()[np.ix_(free, free)]
    M = model.mass(properties).full()[np.ix_(free, free)]
    V = (M @ natural_modes(model, count=3).shapes[free])[:, :rank]
    d = np.array([2.0, 0.0, 30.0])[:rank]
    A = s**2 * M + K + s * (V * d) @ V.T

    together = (k + (s**2).real * m, 1.0), ((s**2).imag * m, 0.0)
    real, imaginary = (node_blocks(model, cs.MX(part), unit) for part, unit in together)
    places = np.zeros((model.size - NODE, len(A)))
    places[node_places(model), np.arange(len(A))] = 1.0
    elimination = Elimination(parts, model.size - NODE, rank, as_it_is)
    factors = elimination.factors(
        cs.vertcat(real, imaginary)[: 48 * parts, :], cs.MX(cs.DM(places @ V)), cs.MX(cs.DM(d)), s
    )
    assert factors.numel() == elimination.layout.size
    right = np.random.default_rng(0).normal(size=(len(A), 2)) / model.scale[free][:, None]
    found = places.T @ cs.evalf(elimination.solve(factors, cs.MX(cs.DM(places @ right[:, :parts])))).full()
    expected = np.linalg.solve(A, right[:, :parts] @ [1.0, 1.0j][:parts])
    scale = model.scale[free]
    error = abs(found @ [1.0, 1.0j][:parts] - expected) / scale
    assert error.max() < 1e-9 * (abs(expected) / scale).max()
