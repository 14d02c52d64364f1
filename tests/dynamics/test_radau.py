"""Steps of Radau IIA: their cost and their premises."""

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    FrictionDamping,
    HarmonicBase,
    ModalDamping,
    Model,
    Pin,
    RayleighDamping,
    Roller,
    StrainMeasures,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.equations import Equations, shared_equations
from ancf_casadi.dynamics.excitation import excitation_pieces
from ancf_casadi.dynamics.radau import stepper as radau
from ancf_casadi.dynamics.radau.collocation import Collocation, first_equal
from ancf_casadi.dynamics.start import initial_state

BEAM = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
SWING = HarmonicBase(amplitude=5e-3, frequency=1.85)
BLOW = HarmonicBase(amplitude=0.1e-3, frequency=94.3388)


def stepper(model, law, base, start, end, tolerance):
    """Return a stepper that has reached the end."""
    equations = Equations(model, law)
    excitation = excitation_pieces(model, base, None, 0.0, end)[0]
    state = initial_state(equations, excitation, start)
    run = radau.Stepper(Collocation(equations), equations.parameters, excitation, state, tolerance)
    for _ in run.steps_to(end):
        pass
    return run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "start", "end", "tolerance"),
    [
        pytest.param(SWING, "equilibrium", 1.5, 1e-5, id="long steps of a large swing"),
        pytest.param(SWING, "equilibrium", 1.5, 1e-7, id="a large swing"),
        pytest.param(BLOW, "impact", 0.2, 5e-5, id="a blow to the clamp"),
    ],
)
def test_newtons_method_takes_two_iterations(base, start, end, tolerance):
    """Residuals turn with the beam; if they turned with the nodes, there would be three to five, and shorter steps."""
    run = stepper(Model(Beam.uniform(**BEAM, elements=20)), RayleighDamping(alpha=0.2325), base, start, end, tolerance)
    assert run.newton.iterations < 2.5 * run.steps
    assert run.newton.factorisations < 1.25 * run.steps


@pytest.mark.slow
def test_a_tight_tolerance_is_met_with_matrices_that_serve_several_steps():
    """Corrections of the links add up along the beam, so those that Newton's method leaves count many times."""
    model = Model(Beam.uniform(**BEAM, elements=20, axis=(1.0, 0.0), gravity=(0.0, 0.0)))
    settings = {
        "damping": RayleighDamping(alpha=0.2, beta=3e-5),
        "start": static_equilibrium(model, tip_force=(0.0, 0.13)),  # bends the tip aside by 0.6 L
        "duration": 0.3,
        "sample_rate": 200.0,
    }
    run, accurate = (simulate(model, tolerance=tolerance, **settings) for tolerance in (1e-9, 1e-11))
    assert abs(run.tip - accurate.tip).max() < 0.5 * 1e-9 * model.beam.length


def test_damping_that_the_matrices_omit_does_not_renew_them_in_each_step():
    """Modal damping slows down Newton's method, with new matrices as with old ones."""
    model = Model(Beam.uniform(**BEAM, elements=8))
    law = ModalDamping(natural_modes(model, count=5), (0.0100, 0.0028, 0.0028, 0.0023, 0.0030))
    run = stepper(model, law, SWING, "equilibrium", 1.5, 1e-5)
    assert run.newton.factorisations < 0.9 * run.steps
    assert run.newton.iterations < 2.5 * run.steps


def test_samples_do_not_change_the_steps():
    """Sampling a step does not alter it."""
    model = Model(Beam.uniform(**BEAM, elements=6))
    runs = [
        simulate(model, base=SWING, start="equilibrium", duration=0.2, sample_rate=rate, method="radau")
        for rate in (50.0, 2000.0)
    ]
    np.testing.assert_allclose(runs[0].coordinates, runs[1].coordinates[::40], rtol=0, atol=1e-13)
    assert runs[0].steps == runs[1].steps


# --------------------------------------------------------------------------------------------------- shared Functions


@pytest.mark.filterwarnings("ignore:the frequency of mode")
@pytest.mark.filterwarnings("ignore:the modes of ModalDamping are")
def test_functions_serve_all_numbers_of_a_law_and_a_beam_but_no_other_law_mesh_axis_or_support():
    beam = Beam.uniform(**BEAM, elements=2)
    modes = natural_modes(Model(beam), count=2)
    laws = {
        "modal": ModalDamping(modes, (0.01, 0.02)),
        "frequencies": ModalDamping(modes, (0.01, 0.02), frequencies=(1.0, 2.0)),  # constants in the force
        "mode": ModalDamping(modes, (0.01,)),
        "strain rate": RayleighDamping(0.2, 1e-3),
        "tangent": RayleighDamping(0.2, 1e-3, stiffness="tangent"),
        "friction": FrictionDamping(0.1, smoothing_speed=1e-3),
        "speed": FrictionDamping(0.1, smoothing_speed=2e-3),
    }
    beams = [beam, *(beam.with_(**{name: value}) for name, value in (("length", 0.6), ("axis", (1.0, 0.0))))]
    beams += [beam.with_(clamp_stiffness=0.5), beam.with_(tip_mass=1e-3), Beam.uniform(**BEAM, elements=3)]
    rollers = [(Pin(0.0), Roller(0.5, direction)) for direction in ((1.0, 0.0), (1.0, 0.5))]
    pins = [(Pin(0.0), Pin(0.5, displacement=displacement)) for displacement in ((0.0, 0.0), (0.0, -1e-3))]
    beams += [beam.with_(supports=supports) for supports in (*rollers, *pins, (Pin(0.0), Pin(0.25)))]
    models = [*map(Model, beams), Model(beam, StrainMeasures(axial="green"))]
    forms = [Collocation(Equations(models[0], law)) for law in laws.values()]
    forms += [Collocation(Equations(model, RayleighDamping(alpha=0.2))) for model in models]
    assert len(set(forms)) == len(forms)
    softer = Model(beam.with_(elastic_modulus=200e9, thickness=0.4e-3, gravity=(0.0, 0.0)))
    assert Collocation(Equations(softer, ModalDamping(modes, (0.03, 0.04)))) == forms[0]
    assert Collocation(Equations(softer, RayleighDamping(alpha=0.3))) == forms[len(laws)]
    for other in (beam.with_(clamp_stiffness=0.6), beam.with_(tip_mass=2e-3)):
        assert Collocation(Equations(Model(other), RayleighDamping(alpha=0.3))) in forms[len(laws) + 3 :]


def clear_caches():
    shared_equations.clear()
    first_equal.cache_clear()


@pytest.mark.slow
def test_a_run_with_the_functions_of_another_run_has_the_same_digits(uncompiled):
    model = Model(Beam.uniform(**BEAM, elements=3, tip_mass=1e-3, clamp_stiffness=0.5))
    settings = {"damping": RayleighDamping(0.3, 1e-3), "base": SWING, "duration": 0.2, "sample_rate": 50.0}
    clear_caches()
    alone = simulate(model, **settings)
    clear_caches()
    other = model.beam.with_(elastic_modulus=100e9, tip_mass=2e-3, clamp_stiffness=0.3)
    simulate(Model(other), **{**settings, "damping": RayleighDamping(0.1, 2e-3)})
    shared = simulate(model, **settings)
    assert first_equal.cache_info().hits == 1
    for name in ("coordinates", "velocities", "clamp_force", "dissipated_energy"):
        np.testing.assert_array_equal(getattr(shared, name), getattr(alone, name))


def test_a_beam_of_a_tenth_of_a_micrometre_moves_as_one_of_half_a_metre():
    tips = []
    for length in (0.5, 1e-7):
        beam = Beam.uniform(length=length, width=length / 10, thickness=length / 100, density=2300.0,
                            elastic_modulus=160e9, elements=2, axis=(1.0, 0.0), gravity=(0.0, 0.0))  # fmt: skip
        model = Model(beam)
        bent = static_equilibrium(model, tip_force=(0.0, 0.3 * beam.bending_stiffness[0] / length**2))
        period = 1 / natural_modes(model, count=1).frequencies[0]
        motion = simulate(model, start=bent, duration=period, sample_rate=20 / period, method="radau")
        tips.append(motion.tip / length)
    np.testing.assert_allclose(*tips, atol=1e-5)
