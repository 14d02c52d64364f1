"""Tests of fits to response curves."""

import numpy as np
import pytest

from ancf_casadi import (
    FitError,
    FrictionDamping,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    natural_modes,
    simulate,
    static_equilibrium,
)
from problems import FrequencyRecord, MarkerRecord, ResponseRecord, compare_laws, fit_beam
from problems.beam.curves.block import curve_block
from problems.beam.curves.points import Measured, closest, motion_from_rest
from tests.problems.beam.response_curves import noisy, swept

RATIO, ETA2, FREQUENCY = 0.006, 1.0, 1.01
LEVELS = (0.5e-3, 2e-3, 6e-3)


@pytest.fixture(scope="module")
def model(paper_beam):
    return Model(paper_beam(elements=4))


@pytest.fixture(scope="module")
def modes(model):
    return natural_modes(model, count=1)


@pytest.fixture(scope="module")
def law(modes):
    """Linear and quadratic damping about mode 1."""
    return ModalDamping(modes, ratios=[RATIO]) + QuadraticDamping(eta2=ETA2)


@pytest.fixture(scope="module")
def curves(model, modes, law):
    """Records without noise of a beam with a damping law, at three levels, and this law."""
    around = np.concatenate([[0.96, 0.98], np.linspace(0.985, 1.015, 9), [1.02, 1.04]])
    frequencies = FREQUENCY * modes.frequencies[0] * around
    records = [
        ResponseRecord(frequencies, np.ones(13), base=HarmonicBase(amplitude=level, frequency=1.0), sweep="up")
        for level in LEVELS
    ]
    return law, [(record, swept(model, law, record, modes=3, frequency_1=FREQUENCY)) for record in records]


def measured(curves, seed=0, **settings):
    rng = np.random.default_rng(seed)
    return [noisy(record, curve, rng, **settings) for record, curve in curves[1]]


@pytest.fixture(scope="module")
def fit(model, modes, curves):
    guess = ModalDamping(modes, ratios=[0.015]) + QuadraticDamping(eta2=0.3)
    return fit_beam(model, measured(curves), guess)


@pytest.mark.slow
def test_a_fit_recovers_the_law_from_three_noisy_curves(fit):
    truth = {"ratio1": RATIO, "eta2": ETA2, "frequency_1": FREQUENCY}
    assert list(fit.estimates) == list(truth)
    for name, value in truth.items():
        assert abs(fit.estimates[name] - value) < 3.5 * fit.standard_errors[name]
    assert fit.standard_errors["ratio1"] < 0.02 * RATIO
    assert fit.standard_errors["eta2"] < 0.03 * ETA2
    factors = fit.solution.problem.blocks[0].weights.deviations  # the noise sets them
    assert (np.abs(factors - 1.0) < 0.5).all()
    assert fit.fit.residual_rms == pytest.approx(fit.solution.problem.scale, rel=0.05)


@pytest.mark.slow
def test_another_start_gives_the_same_estimates(model, modes, curves, fit):
    guess = ModalDamping(modes, ratios=[0.003]) + QuadraticDamping(eta2=3.0)
    other = fit_beam(model, measured(curves), guess)
    assert (np.abs(other.fit.values - fit.fit.values) < 0.01 * fit.fit.errors).all()


@pytest.mark.slow
def test_the_report_names_records_and_an_error_of_the_levels(fit):
    text = fit.report()
    assert "displacement x, tip, 2 mm, up: 13 points" in text
    assert "if all of them are 1 % too small" in text
    assert {"kind", "law", "estimates", "records", "warnings"} <= set(fit.to_dict())
    assert {"records", "level_shifts", "truncation_shifts"} <= set(fit.to_dict()["records"][0])


@pytest.mark.slow
def test_an_uncertain_level_makes_the_damping_uncertain(model, modes, curves, fit):
    """One per cent of the level is one per cent of the linear damping, far more than the noise leaves."""
    guess = ModalDamping(modes, ratios=[0.006]) + QuadraticDamping(eta2=1.0)
    wrong = [
        ResponseRecord(
            record.frequencies, record.values, record.phases, sweep="up",
            base=HarmonicBase(amplitude=1.01 * record.base.amplitude, frequency=1.0),
        )
        for record in measured(curves)
    ]  # fmt: skip
    blind = fit_beam(model, wrong, guess)
    assert abs(blind.estimates["ratio1"] - RATIO) > 2 * blind.standard_errors["ratio1"]
    allowed = fit_beam(
        model, wrong, guess, unknowns=["natural_frequencies", "excitation"], priors={"excitation": (1.0, 0.01)}
    )
    for name, value in {"ratio1": RATIO, "eta2": ETA2}.items():
        assert abs(allowed.estimates[name] - value) < 2.5 * allowed.standard_errors[name]
    assert not any("are taken as exact" in note for note in allowed.warnings)


@pytest.mark.slow
def test_coloured_noise_widens_the_intervals(model, modes, curves):
    rng, records = np.random.default_rng(3), []
    for record, curve in curves[1]:
        errors = rng.standard_normal(curve.shape)
        for k in range(1, len(errors)):
            errors[k] = 0.9 * errors[k - 1] + np.sqrt(1 - 0.9**2) * errors[k]
        smooth = curve * np.array([1.0, 0.0]) * (1 + 0.01 * errors) + curve * np.array([0.0, 1.0]) + 0.01 * errors
        smooth[:, 0] = curve[:, 0] * (1 + 0.01 * errors[:, 0])
        records.append(ResponseRecord(record.f, smooth[:, 0], smooth[:, 1], base=record.base, sweep="up"))
    found = fit_beam(model, records, ModalDamping(modes, ratios=[0.006]) + QuadraticDamping(eta2=1.0))
    assert (found.fit.errors > 1.2 * found.fit.white_errors).all()


@pytest.mark.slow
def test_laws_are_told_apart(model, modes, curves):
    linear = ModalDamping(modes, ratios=[0.01])
    laws = [linear + FrictionDamping(eta0=0.02), linear + QuadraticDamping(eta2=0.3)]
    comparison = compare_laws(model, measured(curves)[::2], laws)
    assert comparison.best is comparison.fits[1]
    assert comparison.verdict.settled
    assert min(comparison.verdict.bic) < max(comparison.verdict.bic) - 10.0


@pytest.mark.slow
def test_a_fit_predicts_a_curve_at_another_level(model, curves, fit):
    base = HarmonicBase(amplitude=4e-3, frequency=1.0)
    record = ResponseRecord(curves[1][0][0].frequencies, np.ones(13), base=base, sweep="up")
    curve = swept(model, curves[0], record, modes=3, frequency_1=FREQUENCY)
    prediction = fit.predict(noisy(record, curve, np.random.default_rng(1)))
    amplitude, _ = prediction.channels
    error = np.abs(amplitude.predicted - curve[:, 0])
    assert (error < 4 * amplitude.errors + 1e-4 * curve[:, 0]).all()
    assert not prediction.warnings
    assert "amplitude" in prediction.report()


@pytest.mark.slow
def test_the_response_may_be_held_instead_of_the_excitation(model, modes, curves):
    """The levels that keep the response at 30 mm, with errors of 1 %."""
    law = curves[0]
    frequencies = FREQUENCY * modes.frequencies[0] * np.linspace(0.97, 1.03, 13)
    base = HarmonicBase(amplitude=1e-3, frequency=1.0)
    record = ResponseRecord(frequencies, np.full(13, 0.03), np.zeros(13), base=base, control="response")
    exact = held(model, law, record)
    errors = 0.01 * np.random.default_rng(5).standard_normal((2, 13))
    record = ResponseRecord(
        frequencies, np.full(13, 0.03), exact[:, 1] + errors[0], base=base, levels=exact[:, 2] * (1 + errors[1]),
        control="response",
    )  # fmt: skip
    found = fit_beam(model, record, ModalDamping(modes, ratios=[0.02]))
    at_30_mm = law.damping_ratios(modes, [0.03])[0]
    assert abs(found.estimates["ratio1"] - at_30_mm) < 0.03 * at_30_mm


def held(model, law, record):
    """Return amplitude, phase and level of the motions with the amplitudes of a record, (m, 3)."""
    block = curve_block(model, [(1, record)], law, (), {}, modes=3, harmonics=5)
    beam, s = block.driven_beams({})[0], block.system_unknowns({"frequency_1": FREQUENCY})
    deviations = np.array([1e-6, 1e6, 1e6])
    points = [Measured(2 * np.pi * f, np.array([0.03, np.nan, 1.0]), deviations) for f in record.f]
    return np.array([closest(beam, point, s, motion_from_rest(beam, point, s)).values for point in points])


@pytest.mark.slow
def test_frequencies_beside_curves_share_the_modulus(model, modes, curves):
    frequencies = FrequencyRecord(model, FREQUENCY * modes.frequencies, std=[1e-5])
    guess = ModalDamping(modes, ratios=[0.006]) + QuadraticDamping(eta2=1.0)
    alone = fit_beam(model, measured(curves)[:1], guess, unknowns=["elastic_modulus"])
    joint = fit_beam(model, [measured(curves)[0], frequencies], guess)
    assert joint.standard_errors["elastic_modulus"] < alone.standard_errors["elastic_modulus"]
    assert "elastic_modulus" in joint.estimates
    assert "frequency_1" not in joint.estimates


@pytest.mark.parametrize(
    ("settings", "where"),
    [
        ({"unknowns": ["colour"]}, "unknowns"),
        ({"unknowns": ["base_amplitude"]}, "unknowns"),
        ({"unknowns": ["natural_frequencies", "elastic_modulus"]}, "unknowns"),
        ({"unknowns": ["tip_mass"]}, "tip_mass"),
        ({"unknowns": ["excitation"], "priors": {"excitation": (1.0, 0.0)}}, "priors: excitation"),
        ({"priors": {"excitation": (1.0, 0.1)}}, "priors"),
        ({"fixed": ["eta9"]}, "fixed"),
        ({"bounds": {"eta9": (0.0, 1.0)}}, "bounds"),
        ({"bounds": {"frequency_1": 1.0}}, "bounds: frequency_1"),
        ({"modes": 0}, "modes"),
        ({"harmonics": 1.5}, "harmonics"),
    ],
)
def test_unusable_settings_are_refused_by_name(model, modes, settings, where):
    record = ResponseRecord(modes.frequencies[0] * np.linspace(0.96, 1.04, 9), np.ones(9), base=HarmonicBase(1e-3, 1.0))
    with pytest.raises(InputError) as caught:
        fit_beam(model, record, RayleighDamping(alpha=0.1), **settings)
    assert caught.value.where == where


@pytest.mark.slow
def test_a_response_that_the_beam_cannot_have_is_named(model, modes, curves):
    record = ResponseRecord([1.9, 1.95], [3.0, 2.0], base=HarmonicBase(amplitude=1e-3, frequency=1.0))
    with pytest.raises(FitError, match=r"1\.9 Hz"):
        fit_beam(model, record, ModalDamping(modes, ratios=[0.01]))


@pytest.fixture(scope="module")
def small_curve(model, modes):
    """Frequencies, amplitudes and phases of small motion on a moving base, and what a fit makes of such a record."""
    f = FREQUENCY * modes.frequencies[0] * np.array([0.98, 0.99, 0.995, 1.0, 1.005, 1.01, 1.02])
    base, law = HarmonicBase(amplitude=1e-5, frequency=1.0), ModalDamping(modes, ratios=[RATIO])
    curve = swept(model, law, ResponseRecord(f, np.ones(7), base=base), modes=3, frequency_1=FREQUENCY)

    def checked(amplitudes, phases):
        record = ResponseRecord(f, amplitudes, phases, base=base)
        block = curve_block(model, [(1, record)], law, ("ratio1",), {}, modes=3, harmonics=3)
        return record, block.orient(modes.frequencies)

    return curve[:, 0], curve[:, 1], checked


@pytest.mark.parametrize(
    ("sign", "turn", "note"),
    [
        (1, 2, "the phases count from the negative displacement; 180 degrees were added"),
        (-1, 0, "the phases are lags; their sign was changed"),
        (1, 3, "the phases count from the rate of the displacement; 90 degrees were added"),
        (1, 0, None),
    ],
)
def test_phases_that_count_from_elsewhere_are_turned_before_a_fit(small_curve, sign, turn, note):
    amplitudes, phases, checked = small_curve
    record, block = checked(amplitudes, sign * (phases + turn * np.pi / 2))
    assert block.notes == ((f"{record.label}: {note}",) if note else ())
    np.testing.assert_allclose(np.exp(1j * block.records[0].measured_phases), np.exp(1j * phases), atol=1e-9)
    assert (block.records[0] is record) == (note is None)


def test_a_level_in_another_unit_is_named_before_a_fit(small_curve):
    amplitudes, phases, checked = small_curve
    (note,) = checked(1e3 * amplitudes, phases)[1].notes  # in mm
    assert "times that of the model; check the unit of its levels" in note and "such as mm" in note


@pytest.mark.slow
def test_the_modulus_is_a_factor_on_the_stiffness_of_the_model(model, modes, law):
    """The response of the model with a larger modulus is that of the beam with this modulus."""
    record = ResponseRecord(
        modes.frequencies[0] * np.array([0.98, 1.0, 1.03]), np.ones(3), base=HarmonicBase(2e-3, frequency=1.0)
    )
    stiffer = Model(model.beam.with_(elastic_modulus=1.05 * model.beam.elastic_modulus[0]))
    expected = swept(stiffer, law, record, modes=4)
    np.testing.assert_allclose(swept(model, law, record, modes=4, elastic_modulus=1.05), expected, rtol=2e-3)


@pytest.mark.slow
def test_decays_and_curves_together_have_smaller_errors_than_either(paper_beam):
    model = Model(paper_beam(elements=3))
    modes = natural_modes(model, count=1)
    law = ModalDamping(modes, ratios=[RATIO]) + QuadraticDamping(eta2=ETA2)
    held = static_equilibrium(model, tip_force=(0.01, 0.0))
    run = simulate(model, damping=law, start=held, duration=1.0, sample_rate=40.0, method="radau")
    rng = np.random.default_rng(7)
    decay = MarkerRecord(run.time, run.tip + 3e-4 * rng.standard_normal(run.tip.shape), start=held)
    stiffness = ["elastic_modulus"]
    around = modes.frequencies[0] * np.concatenate([[0.96, 0.98], np.linspace(0.985, 1.015, 9), [1.02, 1.04]])
    record = ResponseRecord(around, np.ones(13), base=HarmonicBase(LEVELS[2], 1.0), sweep="up")
    records = [noisy(record, swept(model, law, record, modes=3)[:, :2], rng)]
    settings = {"unknowns": [*stiffness, "excitation"], "priors": {"excitation": (1.0, 0.01)}}
    by_decay = fit_beam(model, decay, law, unknowns=stiffness)
    by_curves = fit_beam(model, records, law, **settings)
    both = fit_beam(model, [*records, decay], law, **settings)
    for name, value in {"ratio1": RATIO, "eta2": ETA2, "elastic_modulus": model.beam.elastic_modulus[0]}.items():
        alone = min(by_decay.standard_errors[name], by_curves.standard_errors[name])
        assert both.standard_errors[name] < alone
        assert abs(both.estimates[name] - value) < 3.5 * both.standard_errors[name]
