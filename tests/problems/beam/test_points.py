"""Tests of the motions closest to measured points."""

import math

import numpy as np
import pytest

from ancf_casadi import (
    HarmonicBase,
    HarmonicLoad,
    ModalDamping,
    Model,
    QuadraticDamping,
    linear_frf,
    natural_modes,
    reduce_model,
    simulate_reduced,
)
from ancf_casadi.records.sensor import Sensor
from problems import ResponseRecord
from problems.beam.curves.driven import driven_beam, fourier_coefficients
from problems.beam.curves.points import Measured, closest, motion_from_rest

MODES = 2


@pytest.fixture(scope="module")
def model(paper_beam):
    return Model(paper_beam(elements=8))


@pytest.fixture(scope="module")
def law(model):
    return ModalDamping(natural_modes(model, count=2), ratios=(0.03, 0.003)) + QuadraticDamping(eta2=0.1)


def beam_of(model, law, record, harmonics=5):
    return driven_beam(reduce_model(model, modes=MODES, damping=law), record, harmonics)


def unknowns(law):
    return np.array([*(parameter.value for parameter in law.parameters), *np.ones(MODES + 1)])


@pytest.mark.parametrize(
    "sensor",
    [
        Sensor(),
        Sensor("acceleration", point=0.3, frame="body", direction=(0.0, 1.0)),
        Sensor("strain", point=0.02),
        Sensor("force"),
    ],
    ids=lambda sensor: sensor.quantity,
)
def test_derivatives_of_balance_and_reading_agree_with_differences(model, law, sensor):
    record = ResponseRecord([1.8], [0.01], sensor=sensor, base=HarmonicBase(amplitude=2e-3, frequency=1.0))
    beam, rng = beam_of(model, law, record), np.random.default_rng(0)
    s = 1.01 * unknowns(law)
    curve = beam.curve(11.0, s)
    z = np.append(1e-3 * rng.standard_normal(len(curve.scale) - 1), 2e-3)
    by_z, by_s = 1e-3 * rng.standard_normal(z.size), rng.standard_normal(s.size) * s
    h, (_, polar_by_z, polar_by_s) = 1e-6, beam.read(curve, z)
    ends = [(beam.curve(11.0, s + t * by_s), z + t * by_z) for t in (h, -h)]
    linear = curve.at(z, by_z).linear
    expected = np.column_stack([linear.by_coefficients, linear.by["amplitude"]]) @ by_z
    expected += curve.balance.by_parameters(*curve.split(z), by_s[:, None])[:, 0]
    forces = [curve.residual(z) for curve, z in ends]
    np.testing.assert_allclose((forces[0] - forces[1]) / (2 * h), expected, atol=1e-8 * abs(expected).max())
    polar = [beam.read(curve, z)[0] for curve, z in ends]
    expected = polar_by_z @ by_z + polar_by_s @ by_s
    np.testing.assert_allclose((polar[0] - polar[1]) / (2 * h), expected, rtol=1e-4, atol=1e-7)
    reduced = reduce_model(model, modes=MODES, damping=law)
    motions = [np.hstack(pair) for pair in zip(*(curve.balance.motion(*curve.split(z)) for _, z in ends), strict=True)]
    F, numbers = fourier_coefficients(reduced, record, beam.fourier, motions, s)
    for k, (_, z) in enumerate(ends):
        exact, (size, phase) = curve.residual(z), beam.read(curve, z)[0]
        np.testing.assert_allclose(F[k][curve.balance.allowed], exact, atol=1e-11 * abs(exact).max())
        assert numbers[k] == pytest.approx(size * np.exp(1j * phase), rel=1e-9)


def test_small_motion_has_the_linear_transmissibility(model):
    modes = natural_modes(model, count=MODES)
    law = ModalDamping(modes, ratios=(0.02, 0.01))
    record = ResponseRecord([1.9], [1e-7], base=HarmonicBase(amplitude=1e-8, frequency=1.0))
    beam, omega = beam_of(model, law, record), 2 * math.pi * 1.9
    s = np.array([0.02, 0.01, 1.0, 1.0, 1.0])
    motion = motion_from_rest(beam, Measured(omega, np.array([1e-7, math.nan, 1.0]), np.ones(3)), s)
    frf = linear_frf(model, damping=law, frequencies=[1.9], kind="transmissibility")
    found = motion.values[0] / (motion.level * 1e-8) * np.exp(1j * motion.values[1])
    assert found == pytest.approx(complex(np.ravel(frf.values)[0]), rel=2e-3)  # two modes of all


@pytest.mark.slow
def test_a_large_motion_is_the_end_of_a_long_simulation(model, law):
    f = 0.99 * natural_modes(model, count=1).frequencies[0]
    base = HarmonicBase(amplitude=2e-3, frequency=f)
    record = ResponseRecord([f], [0.03], base=base)
    beam, s = beam_of(model, law, record, harmonics=7), unknowns(law)
    point = Measured(2 * math.pi * f, np.array([0.03, math.nan, 1.0]), np.array([1e6, 1e6, 1e-6]))
    motion = closest(beam, point, s, motion_from_rest(beam, point, s))
    assert motion.level == pytest.approx(1.0, abs=1e-9)
    periods, rate = 500, 200
    reduced = reduce_model(model, modes=MODES, damping=law)
    run = simulate_reduced(reduced, duration=periods / f, base=base, sample_rate=rate * f)
    phases = 2 * math.pi * np.arange(rate) / rate
    x = run.tip[-rate - 1 : -1, 0]
    sine, cosine = 2 / rate * np.array([x @ np.sin(phases), x @ np.cos(phases)])
    assert motion.values[0] == pytest.approx(math.hypot(sine, cosine), abs=1e-6 * 0.5)
    assert motion.values[1] == pytest.approx(math.atan2(cosine, sine), abs=1e-5)


def test_a_load_at_the_tip_bends_as_much_as_its_receptance(model):
    modes = natural_modes(model, count=MODES)
    law = ModalDamping(modes, ratios=(0.02, 0.01))
    record = ResponseRecord([1.7], [1e-7], load=HarmonicLoad(force=(1e-6, 0.0), frequency=1.0))
    beam, s = beam_of(model, law, record), np.array([0.02, 0.01, 1.0, 1.0, 1.0])
    point = Measured(2 * math.pi * 1.7, np.array([1e-7, math.nan, 1.0]), np.ones(3))
    motion = motion_from_rest(beam, point, s)
    frf = linear_frf(model, damping=law, frequencies=[1.7])
    found = motion.values[0] / (motion.level * 1e-6) * np.exp(1j * motion.values[1])
    assert found == pytest.approx(complex(np.ravel(frf.values)[0]), rel=2e-3)


def test_the_curve_is_followed_around_a_fold(model, law):
    """Below the second mode, which softens, three motions have the same level."""
    modes = natural_modes(model, count=2)
    f = 0.99 * modes.frequencies[1]
    record = ResponseRecord([f], [0.01], base=HarmonicBase(amplitude=1e-4, frequency=1.0))
    beam, s = beam_of(model, law, record), unknowns(law)
    slopes = [
        motion_from_rest(beam, Measured(2 * math.pi * f, np.array([Y, math.nan, 1.0]), np.ones(3)), s).slopes[2]
        for Y in (0.005, 0.018, 0.03)
    ]
    assert slopes[0] > 0.0 > slopes[1]
    assert slopes[2] > 0.0


@pytest.mark.parametrize("level", [1.0, 4.0])
def test_the_closest_motion_is_that_with_the_smallest_distance(model, law, level):
    """Also for a level beyond the fold, which no motion nearby has."""
    modes = natural_modes(model, count=2)
    f = 0.99 * modes.frequencies[1]
    record = ResponseRecord([f], [0.01], base=HarmonicBase(amplitude=1e-4, frequency=1.0))
    beam, s = beam_of(model, law, record), unknowns(law)
    point = Measured(2 * math.pi * f, np.array([0.011, 2.6, level]), np.array([2e-4, 0.02, 0.01]))
    found = closest(beam, point, s, motion_from_rest(beam, point, s))
    best = np.sum(point.distance(found.values) ** 2)
    for along in found.values[0] * np.array([-0.03, -0.01, -0.001, 0.001, 0.01, 0.03]):
        assert np.sum(point.distance(found.advance(along).values) ** 2) > best
