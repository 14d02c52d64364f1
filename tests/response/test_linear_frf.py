import cmath
import json
import re

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    EquilibriumError,
    FrictionDamping,
    HarmonicBase,
    HarmonicLoad,
    InputError,
    ModalDamping,
    Model,
    Pin,
    QuadraticDamping,
    RayleighDamping,
    linear_frf,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.damping import FRICTION_CONSTANT
from ancf_casadi.figures.files import figure_bytes
from ancf_casadi.vibration.statics import primary_equilibrium


def cantilever_tip(beam, bending_stiffness, f, alpha=0.0, beta=0.0):
    """Receptance and transmissibility of the tip of an Euler-Bernoulli cantilever, from the ordinary differential
    equation EI (1 + i w beta) y'''' = mu (w^2 - i w alpha) y.
    """
    mu = beam.density[0] * beam.sections[0].area
    receptance, transmissibility = [], []
    for omega in 2 * np.pi * f:
        stiffness = bending_stiffness * (1 + 1j * omega * beta)
        k = (mu * (omega**2 - 1j * omega * alpha) / stiffness) ** 0.25
        x = k * beam.length
        sin, cos, sinh, cosh = cmath.sin(x), cmath.cos(x), cmath.sinh(x), cmath.cosh(x)
        receptance.append((sin * cosh - cos * sinh) / (stiffness * k**3 * (1 + cos * cosh)))
        transmissibility.append((cos + cosh) / (1 + cos * cosh))
    return np.array(receptance), np.array(transmissibility)


F = np.concatenate([np.linspace(0.5, 12.0, 47), np.linspace(25.0, 31.0, 31)])


@pytest.mark.parametrize(("alpha", "beta"), [(0.3, 0.0), (0.0, 2e-4), (0.3, 2e-4)])
def test_receptance_and_transmissibility_are_those_of_the_differential_equation(
    paper_beam, bending_stiffness, alpha, beta
):
    law, beam = RayleighDamping(alpha=alpha, beta=beta), paper_beam(60, axis=(1.0, 0.0), gravity=(0.0, 0.0))
    model = Model(beam)
    receptance, transmissibility = cantilever_tip(beam, bending_stiffness(beam), F, alpha, beta)
    options = {"frequencies": F}
    found = linear_frf(model, law, **options).values[0, 0]
    assert np.abs(found / receptance - 1).max() < 2e-4
    absolute = linear_frf(model, law, kind="transmissibility", **options).values[0, 0]
    assert np.abs(absolute / transmissibility - 1).max() < 2e-4
    relative = linear_frf(model, law, kind="relative-transmissibility", **options).values[0, 0]
    np.testing.assert_allclose(relative, absolute - 1, rtol=1e-9)


def test_the_error_of_the_mesh_falls_with_the_fourth_power(paper_beam, bending_stiffness):
    f, errors = np.array([5.0, 15.0, 25.0]), []
    for elements in (5, 10):
        beam = paper_beam(elements, axis=(1.0, 0.0), gravity=(0.0, 0.0))
        exact, _ = cantilever_tip(beam, bending_stiffness(beam), f, alpha=0.3)
        found = linear_frf(Model(beam), RayleighDamping(alpha=0.3), f).values[0, 0]
        errors.append(np.abs(found / exact - 1).max())
    assert 12.0 < errors[0] / errors[1] < 20.0


@pytest.mark.parametrize("law", ["mass", "tangent", "modal", "sum"])
def test_it_is_the_sum_over_all_modes_under_laws_that_keep_modes_apart(paper_beam, law):
    model = Model(paper_beam(8))
    modes = natural_modes(model, count=32)
    ratios = np.linspace(0.002, 0.03, 32)
    laws = {
        "mass": RayleighDamping(alpha=0.2),
        "tangent": RayleighDamping(beta=1e-4, stiffness="tangent"),
        "modal": ModalDamping(modes, ratios),
    }
    damping = laws["mass"] + laws["modal"] if law == "sum" else laws[law]
    zeta, omega = damping.damping_ratios(modes, np.zeros(32)), modes.angular_frequencies
    points, loads = (0.1, 0.3, 0.5), (0.2, 0.5)
    left, right = (
        np.array([np.array(way) @ model.interpolation(s) @ modes.shapes for s in at])
        for at, way in ((points, (1.0, 0.0)), (loads, (0.6, 0.8)))
    )
    w = 2 * np.pi * F
    resonances = 1 / (omega[:, None] ** 2 - w**2 + 2j * (zeta * omega)[:, None] * w)
    expected = np.einsum("ir,jr,rk->ijk", left, right, resonances)
    for kind, power in (("receptance", 0), ("mobility", 1), ("accelerance", 2)):
        found = linear_frf(model, damping, F, kind=kind, points=points, load_points=loads, load_direction=(3.0, 4.0))
        size = np.abs(expected * w**power).max(axis=2, keepdims=True)
        assert np.abs((found.values - expected * (1j * w) ** power) / size).max() < 2e-5


def test_a_load_and_a_response_can_be_exchanged(hanging):
    law = ModalDamping(natural_modes(hanging, count=3), (0.01, 0.02, 0.03)) + RayleighDamping(beta=1e-4)
    at = {"points": (0.2, 0.5), "load_points": (0.2, 0.5)}
    values = linear_frf(hanging, law, F, **at).values
    np.testing.assert_allclose(values[0, 1], values[1, 0], rtol=1e-8)


def test_at_zero_frequency_it_is_the_static_compliance(paper_beam):
    model = Model(paper_beam(8, axis=(1.0, 0.0)))
    rest = static_equilibrium(model)
    step = 1e-6
    ends = [static_equilibrium(model, tip_force=(0.0, sign * step)).position(0.3) for sign in (-1, 1)]
    found = linear_frf(model, None, [0.0], points=0.3, equilibrium=rest).values[0, 0, 0]
    assert found == pytest.approx((ends[1] - ends[0])[1] / (2 * step), rel=1e-6)


def test_a_weight_that_hangs_at_the_tip_stiffens_the_beam(paper_beam):
    model = Model(paper_beam(8))
    loaded = static_equilibrium(model, tip_force=(0.0, -0.05))
    first = natural_modes(model, count=1, equilibrium=loaded).frequencies[0]
    frf = linear_frf(model, RayleighDamping(alpha=0.01), equilibrium=loaded)
    assert frf.frequencies[np.argmax(frf.amplitude[0, 0])] == pytest.approx(first, rel=1e-4)
    assert first > 1.1 * natural_modes(model, count=1).frequencies[0]


def harmonic(time, values, frequency):
    """Complex amplitude of a sine at the frequency of the excitation, which is proportional to sin(omega t)."""
    basis = np.column_stack([np.sin(2 * np.pi * frequency * time), np.cos(2 * np.pi * frequency * time)])
    sine, cosine = np.linalg.lstsq(np.column_stack([basis, np.ones_like(time)]), values)[0][:2]
    return sine + 1j * cosine


@pytest.mark.slow
@pytest.mark.parametrize("excitation", ["base", "tip"])
@pytest.mark.parametrize("clamp", [np.inf, 0.05])
def test_it_is_the_end_of_a_simulation_of_small_amplitude(paper_beam, excitation, clamp):
    model = Model(paper_beam(4, clamp_stiffness=clamp))
    modes = natural_modes(model, count=3)
    law = ModalDamping(modes, (0.1, 0.05, 0.05)) + RayleighDamping(alpha=2.0) + QuadraticDamping(eta1=0.5, eta2=0.01)
    frequency, options = 2.2, {"frequencies": [2.2], "points": (0.25, 0.5)}
    motion = {"duration": 15.0, "method": "radau", "sample_rate": 200.0, "tolerance": 1e-11}
    amplitude = 1e-4  # m or N; the tip moves by about a thousandth of the length
    if excitation == "base":
        run = simulate(model, damping=law, base=HarmonicBase(amplitude, frequency), **motion)
        expected = linear_frf(model, law, kind="transmissibility", **options).values[:, 0, 0]
    else:
        load = HarmonicLoad(force=(amplitude, 0.0), frequency=frequency)
        run = simulate(model, damping=law, load=load, **motion)
        expected = linear_frf(model, law, **options).values[:, 0, 0]
    last = run.time > 12.0
    for s, value in zip((0.25, 0.5), expected, strict=True):
        path = run.coordinates[last] @ model.interpolation(s)[0]
        assert abs(harmonic(run.time[last], path, frequency) / amplitude / value - 1) < 2e-5


def test_the_frequencies_that_are_chosen_show_the_resonances(hanging):
    modes = natural_modes(hanging, count=5)
    frf = linear_frf(hanging, ModalDamping(modes, (0.01, 0.003, 0.003, 0.002, 0.002)))
    size = frf.amplitude[0, 0]
    peaks = frf.frequencies[1:-1][(size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])]
    np.testing.assert_allclose(peaks, modes.frequencies, rtol=1e-3)
    assert (np.diff(frf.frequencies) > 0.0).all()


def test_quadratic_drag_has_no_effect_and_a_warning_says_so(hanging):
    linear = RayleighDamping(alpha=0.2)
    both = linear_frf(hanging, linear + QuadraticDamping(eta2=0.5), F)
    np.testing.assert_allclose(both.values, linear_frf(hanging, linear, F).values, rtol=1e-6)
    (warning,) = both.warnings
    assert "the damping depends on the amplitude" in warning and warning in both.report()
    assert not linear_frf(hanging, linear, F).warnings


def test_the_warning_names_a_mode_whose_damping_changes(hanging):
    """Strong viscous damping hides the drag of the lowest modes."""
    (warning,) = linear_frf(hanging, QuadraticDamping(eta1=10.0, eta2=0.1), F).warnings
    before, after = re.search(r"mode [2-9] is (\S+), not (\S+)", warning).groups()
    assert float(before) > 1.005 * float(after)


def test_friction_counts_with_its_slope_at_rest_and_a_warning_says_so(hanging):
    friction = FrictionDamping(eta0=1e-4, smoothing_speed=1e-3)
    found = linear_frf(hanging, friction, F)
    rate = FRICTION_CONSTANT * friction.eta0 / friction.smoothing_speed
    np.testing.assert_allclose(found.values, linear_frf(hanging, RayleighDamping(alpha=rate), F).values, rtol=1e-4)
    assert "the damping depends on the amplitude" in found.warnings[0]


@pytest.mark.slow
def test_the_result_is_reported_drawn_and_written(hanging):
    frf = linear_frf(hanging, RayleighDamping(alpha=0.2), points=(0.25, 0.5), kind="mobility")
    assert "Peaks of the mobility" in frf.report() and "0.25 m / 0.5 m" in frf.report()
    table = json.loads(json.dumps(frf.to_dict()))
    values = np.array(table["real"]) + 1j * np.array(table["imaginary"])
    np.testing.assert_array_equal(values, frf.values)
    assert table["unit"] == "m/(N s)"
    np.testing.assert_allclose(frf.amplitude * np.exp(1j * frf.phase), frf.values)
    figure = frf.figure()
    above, below = figure.axes
    assert len(above.lines) == len(below.lines) == 2
    assert above.get_ylabel() == "mobility, m/(N s)" and figure_bytes(figure).startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "stiffness"}, "kind: must be one of receptance"),
        ({"points": 0.6}, "points: must be on the beam"),
        ({"points": []}, "points: is empty"),
        ({"load_points": (0.1, -0.1)}, "load_points: must be on the beam"),
        ({"direction": (0.0, 0.0)}, "direction: must not be the zero vector"),
        ({"load_direction": 1.0}, "load_direction: must be a pair of numbers"),
        ({"frequencies": [-1.0]}, "frequencies: must be one or more frequencies"),
        ({"frequencies": [1.0, np.nan]}, "frequencies: must be finite"),
        ({"kind": "transmissibility", "load_points": 0.5}, "load_points: has no meaning"),
        ({"damping": 0.01}, "damping: must be a DampingLaw, got 0.01"),
        ({"equilibrium": 1}, "equilibrium: must be an Equilibrium, got 1"),
    ],
)
def test_what_cannot_be_used_is_refused(hanging, options, message):
    with pytest.raises(InputError, match=f"^{message}"):
        linear_frf(hanging, **options)


def test_an_equilibrium_of_another_model_is_refused(hanging, weightless):
    with pytest.raises(InputError, match="equilibrium: belongs to another model"):
        linear_frf(hanging, equilibrium=static_equilibrium(weightless))


def test_an_unstable_equilibrium_has_no_response():
    standing = Beam.uniform(length=1.0, width=5e-3, thickness=0.5e-3, axis=(0.0, 1.0), density=8000.0,
                            elastic_modulus=210e9, elements=4)  # fmt: skip
    with pytest.raises(EquilibriumError, match="unstable"):
        linear_frf(Model(standing), equilibrium=primary_equilibrium(Model(standing), ()))


@pytest.mark.parametrize("supports", [(), (Pin(0.0),), (Clamp(),)])
def test_the_default_frequencies_show_five_resonances_beside_rigid_motions(paper_beam, supports):
    frf = linear_frf(Model(paper_beam(4, supports=supports, gravity=(0.0, 0.0))), RayleighDamping(alpha=0.4))
    assert frf.modes.count == 5
    assert frf.frequencies[-1] > frf.modes.frequencies[4]
    assert frf.modes.frequencies[0] > 1.0
