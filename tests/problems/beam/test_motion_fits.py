"""Damping laws and properties from the large motion of a soft strip, with known truth and seeded noise."""

import gc
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    FitError,
    FrictionDamping,
    HarmonicBase,
    InputError,
    Measurement,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    Sensor,
    State,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.derivatives.sensitivity import MotionRun, SensitivityProblem
from ancf_casadi.estimation.criteria import Candidate, judge
from ancf_casadi.estimation.refinement import LARGEST_SHIFT
from benchmarks.beams import steel
from problems import MarkerRecord, compare_laws, fit_beam, fit_decay
from problems.beam import fitting
from problems.beam.motions import block
from problems.beam.motions.marker_record import motion_record
from problems.beam.motions.weights import COARSE, MODEL_STD, coarse_tolerance, first_weights
from tests.problems.beam.truth import scores

BASE = HarmonicBase(0.02, 2.0, stop=0.5)
NOISE = 0.5e-3  # m
TRUTH = QuadraticDamping(eta1=0.6, eta2=4.0)


@pytest.fixture(scope="module")
def model():
    strip = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
    return Model(Beam.uniform(**strip, elements=3))


def record(model, law, seed, *, base=BASE, start="equilibrium", points=None, duration=1.5):
    """Return a record of some points, or of the tip."""
    settings = {"damping": law, "base": base, "start": start, "duration": duration, "sample_rate": 40.0}
    run = simulate(model, method="radau", tolerance=1e-8, **settings)
    positions = np.stack([run.position(s) for s in points or (model.beam.length,)], axis=1)
    noise = NOISE * np.random.default_rng(seed).normal(size=positions.shape)
    return MarkerRecord(run.time, positions + noise, points=points, base=base, start=start)


@pytest.fixture(scope="module")
def driven(model):
    return record(model, TRUTH, 1)


@pytest.fixture(scope="module")
def again(model, driven):
    """The fit that starts from the truth."""
    return fit_beam(model, driven, TRUTH)


@pytest.mark.slow
@pytest.mark.parametrize("guess", [(0.3, 8.0), (1.5, 1.0)])
def test_the_truth_is_found_from_two_starts(model, driven, again, guess):
    found = fit_beam(model, driven, QuadraticDamping(*guess))
    score = (found.fit.values - [0.6, 4.0]) / found.fit.errors
    assert found.fit.names == ("eta1", "eta2") and (found.law.eta1, found.law.eta2) == tuple(found.fit.values)
    assert abs(score).max() < 3.0
    assert found.fit.residual_rms == pytest.approx(NOISE, rel=0.2)
    assert found.fit.errors[1] < 2.0
    np.testing.assert_allclose(found.fit.values, again.fit.values, atol=1e-2 * again.fit.errors.min())


@pytest.mark.slow
def test_outliers_hardly_move_a_robust_fit(model, driven, again):
    """Six of the last 41 positions are 20 mm too far out, 40 standard deviations of the noise."""
    spoilt = driven.positions.copy()
    chosen = 20 + np.random.default_rng(5).choice(41, 6, replace=False)
    spoilt[chosen, 0, 0] += 0.02 * np.sign(spoilt[chosen, 0, 0])
    plain, robust = (
        fit_beam(model, replace(driven, positions=spoilt), QuadraticDamping(0.3, 8.0), robust=way, tolerance=1e-5)
        for way in (False, True)
    )
    moved = abs(robust.fit.values - again.fit.values) / again.fit.errors
    assert moved.max() < 1.5 < 3.0 < (abs(plain.fit.values - again.fit.values) / again.fit.errors).max()
    assert robust.fit.huber == pytest.approx(1.345 * NOISE, rel=0.3) and math.isinf(plain.fit.huber)
    assert (robust.fit.errors < 1.5 * again.fit.errors).all() and (plain.fit.errors > 5 * again.fit.errors).all()


@pytest.mark.slow
def test_the_figure_has_measured_and_fitted_positions_and_residuals(again, driven):
    motion, residuals = again.figure().axes
    lines = motion.get_lines()
    legend = [text.get_text() for text in motion.get_legend().get_texts()]
    assert len(lines) == 4 and legend == ["measured", "position x, tip", "position y, tip"]
    measured, fitted = (line.get_ydata() for line in lines[:2])
    assert fitted - measured == pytest.approx(1e3 * again.fit.residuals[: len(measured)])
    assert residuals.get_lines()[1].get_ydata() == pytest.approx(1e3 * again.fit.residuals[len(measured) :])
    assert measured == pytest.approx(1e3 * (driven.positions[:, 0, 0] - driven.positions[:, 0, 0].mean()))


@pytest.mark.slow
def test_each_point_is_integrated_once_and_no_steps_are_kept(model, driven, monkeypatch):
    solve, points = SensitivityProblem.solve, []

    def plural(self, values, *given):
        points.append((self.tolerance, *(f"{value:.10e}" for value in values)))
        return solve(self, values, *given)

    monkeypatch.setattr(SensitivityProblem, "solve", plural)
    gc.collect()
    before = sum(type(one) is MotionRun for one in gc.get_objects())
    found = fit_beam(model, driven, QuadraticDamping(0.3, 8.0), tolerance=1e-5)
    assert len(points) == len(set(points)) <= 2 * found.fit.iterations + 3
    gc.collect()
    assert sum(type(one) is MotionRun for one in gc.get_objects()) == before


@pytest.fixture(scope="module")
def exact():
    """A steel strip whose tip swings 70 mm, with modal damping and drag: model, law, and a record without noise."""
    steel = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
    model = Model(Beam.uniform(**steel, elements=3))
    modes = natural_modes(model, count=2)
    law = ModalDamping(modes, (0.01, 0.0028))
    base = HarmonicBase(5e-3, modes.frequencies[0], stop=4.0)
    settings = {"damping": law + QuadraticDamping(eta2=0.2), "base": base, "start": "equilibrium", "duration": 0.8}
    run = simulate(model, method="radau", tolerance=1e-10, sample_rate=100.0, **settings)
    return model, law, MarkerRecord(run.time, run.tip, base=base, start="equilibrium")


def drag(exact, noise, **settings):
    """Fit the drag of a noisy record, the modal ratios known."""
    model, law, without = exact
    given = replace(without, positions=without.positions + noise)
    return fit_beam(model, given, law + QuadraticDamping(eta2=0.1), fixed=("ratio1", "ratio2"), **settings)


@pytest.mark.slow
def test_the_shift_by_the_error_of_integration_is_found_from_one_tighter_integration(exact):
    """Compared with a fit at the tighter tolerance; a coarse tolerance of the user is used, with a warning."""
    coarse, fine = (drag(exact, 0.0, tolerance=tolerance) for tolerance in (1e-4, 1e-8))
    assert coarse.solution.problem.blocks[0].tolerance == 1e-4
    moved = (fine.fit.values - coarse.fit.values) / coarse.fit.errors
    assert abs(moved[0]) > 0.5
    assert (coarse.solution.shifts[0] / moved >= 1.0).all()  # the doubt about the tighter one is added
    assert (coarse.solution.shifts[0] / moved < 2.0).all()  # 1/(1 - r^-p) with r = 10 and the least order
    (note,) = [note for note in coarse.warnings if note.startswith("the integration error")]
    assert "shifts eta2 by" in note
    assert "let the fit select the tolerance" in coarse.report()
    assert "integrated at the tolerance 1.0e-04" in coarse.report()
    assert abs(fine.shifts[0]) < LARGEST_SHIFT and not any("integration" in warning for warning in fine.warnings)
    (said,) = fine.to_dict()["records"]
    assert said["tolerance"] == 1e-8 and said["integration_shifts"] == fine.solution.shifts[0].tolist()


@pytest.fixture(scope="module")
def ringing():
    """A released strip, whose mesh rings, and a record of its tip that was integrated at 1e-6."""
    hanging = Model(steel(axis=(0.0, -1.0), gravity=(0.0, -9.81), elements=10))
    start = static_equilibrium(hanging, tip_force=(0.02, 0.0))
    law = QuadraticDamping(eta1=0.148, eta2=0.1145)
    run = simulate(hanging, damping=law, duration=3.0, sample_rate=200.0, tolerance=1e-6, start=start)
    positions = run.tip + 2e-4 * np.random.default_rng(0).normal(size=run.tip.shape)
    return hanging, law, MarkerRecord(run.time, positions, start=start)


@pytest.mark.slow
def test_the_shift_of_a_ringing_motion_is_not_understated_though_coarser_motions_share_it(ringing):
    """A released strip rings: at 1e-5 and 1e-6 its drag is equally wrong, and 1e-7 shows it."""
    hanging, law, released = ringing
    solution = fit_beam(hanging, released, law, tolerance=1e-6).solution
    (fitted,), fit = solution.problem.blocks, solution.fit
    residuals = replace(fitted, tolerance=1e-7, before=None).residuals_at(fit.estimates)
    moved = np.abs(fit.shifts(solution.problem.scale * residuals - fit.residuals))
    assert (moved > 0.03).all()
    assert (moved < np.abs(solution.shifts[0])).all() and (np.abs(solution.shifts[0]) < 3 * moved).all()


@pytest.mark.slow
def test_each_tolerance_ends_within_the_stated_shift_from_any_start(ringing):
    hanging, law, released = ringing
    accurate = fit_beam(hanging, released, law, tolerance=1e-7).fit
    for tolerance in (1e-4, 1e-5, 1e-6, None):
        for guess in ((0.3, 0.3), (0.05, 0.02), (0.2, 0.5)):
            solution = fit_beam(hanging, released, QuadraticDamping(*guess), tolerance=tolerance).solution
            apart = (solution.fit.values - accurate.values) / accurate.errors
            assert (np.abs(apart) < np.abs(solution.shifts[0])).all()


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_the_fit_selects_a_tolerance_at_which_no_estimate_is_shifted(exact, noise):
    """Without noise the allowance for a systematic error decides; the interval still covers the truth."""
    noise = noise * np.random.default_rng(1).normal(size=exact[2].positions.shape)
    found, accurate = drag(exact, noise), drag(exact, noise, tolerance=1e-8)
    assert found.solution.problem.blocks[0].tolerance < COARSE
    shift = abs(found.fit.values[0] - accurate.fit.values[0]) / accurate.fit.errors[0]
    assert shift < min(LARGEST_SHIFT, abs(found.shifts[0]))
    assert not any("integration" in warning for warning in found.warnings)
    assert abs(found.fit.values[0] - 0.2) < 2 * found.fit.errors[0] < 5e-3
    assert found.fit.systematic == pytest.approx(MODEL_STD * travel(exact[2]), rel=1e-3)


@pytest.mark.slow
def test_a_tolerance_that_is_too_coarse_is_tightened_or_reported(exact, monkeypatch):
    monkeypatch.setattr(fitting, "coarse_tolerance", lambda *_: 1e-3)
    assert drag(exact, 0.0).solution.problem.blocks[0].tolerance < 1e-5
    monkeypatch.setattr(block, "TIGHTEST", 1e-3)
    assert "shorten the record" in drag(exact, 0.0).warnings[-1]


@pytest.mark.slow
def test_estimates_scatter_about_the_truth_by_their_standard_errors(exact):
    """The mean of 8 standardised errors is within 2.6 of its standard deviations in 99 of 100 studies."""
    rng = np.random.default_rng(7)
    scores = []
    for _ in range(8):
        found = drag(exact, 2e-4 * rng.normal(size=exact[2].positions.shape))
        scores.append((found.fit.values[0] - 0.2) / found.fit.errors[0])
    assert abs(np.mean(scores)) < 2.6 / np.sqrt(8)
    assert 0.35 < np.std(scores, ddof=1) < 1.8


def travel(record):
    """Return the root mean square of the positions about their means."""
    return np.sqrt(record.positions.var(axis=0).mean())


def weighted(record):
    return first_weights([motion_record(record)])


def test_the_noise_of_a_record_is_separated_from_its_motion(model, driven):
    weights = weighted(driven)
    assert weights.scale * weights.root_mean_square(weights.floors) == pytest.approx(MODEL_STD * travel(driven))
    time = np.arange(400) / 100.0
    swing = 0.02 * np.stack([np.sin(8 * time), np.cos(5 * time)], axis=1)
    given = NOISE * np.random.default_rng(3).normal(size=swing.shape)
    assert weighted(MarkerRecord(time, swing + given)).deviations == pytest.approx(NOISE, rel=0.1)
    assert weighted(MarkerRecord(time, swing)).deviations.max() < 0.02 * NOISE


def test_the_first_tolerance_follows_the_travel():
    time = np.arange(2000) / 1000.0
    swing = np.stack([np.sin(8 * time), np.cos(5 * time)], axis=1)
    small, large = ([motion_record(MarkerRecord(time, size * swing))] for size in (1e-3, 0.1))
    assert coarse_tolerance(small, 0.5) == pytest.approx(10**-2.2 * 1e-3 / math.sqrt(2) / 0.5, rel=0.05)
    assert coarse_tolerance(large, 0.5) == COARSE
    accelerations = Measurement(time, swing[:, 0], sensor=Sensor("acceleration"))
    assert coarse_tolerance([motion_record(accelerations)], 0.5) == 10**-4.5


def test_a_motion_that_fails_at_the_guess_is_reported(model, driven):
    still = replace(driven, base=None, start=State(np.zeros(3), np.zeros(3)))
    with pytest.raises(
        FitError,
        match="are not finite; start from another guess; the last motion tried: start: the coordinates must be",
    ):
        fit_beam(model, still, TRUTH)


@pytest.mark.slow
def test_residuals_that_are_not_noise_give_a_warning_for_each_law(model):
    """Drag fitted as viscous damping; residuals below the systematic error give no warning."""
    exact = record(model, QuadraticDamping(eta2=8.0), 6)
    exact = replace(exact, positions=exact.positions - NOISE * np.random.default_rng(6).normal(size=(61, 1, 2)))
    laws = [RayleighDamping(alpha=1.0), QuadraticDamping(eta2=4.0)]
    comparison = compare_laws(model, exact, laws, tolerance=1e-6)
    coloured = "but the law does not explain all of the motion"
    wrong, right = comparison.fits
    assert any(coloured in warning for warning in wrong.warnings) and coloured in wrong.report()
    assert wrong.to_dict()["warnings"] == list(wrong.warnings)
    assert right.fit.residual_rms < MODEL_STD * travel(exact) and not any(coloured in one for one in right.warnings)
    assert comparison.best is right
    assert comparison.warnings == (*comparison.verdict.warnings, *right.warnings)
    assert comparison.to_dict()["warnings"] == list(comparison.warnings)


@pytest.mark.slow
def test_records_that_disagree_are_told_of_and_their_scatter_is_in_the_interval(model):
    """The damping of the second record is 10 % higher, or the same."""
    law = RayleighDamping(alpha=1.0)
    first, same, other = (record(model, RayleighDamping(alpha=alpha), seed) for alpha, seed in
                          ((1.0, 1), (1.0, 2), (1.1, 3)))  # fmt: skip
    (agreed,) = fit_beam(model, [first, same], law).agreements
    assert agreed.name == "alpha" and agreed.agrees
    differing = fit_beam(model, [first, other], law)
    (alpha,) = differing.agreements
    assert not alpha.agrees and alpha.values == pytest.approx([1.0, 1.1], abs=4 * alpha.errors.max())
    assert alpha.scatter == pytest.approx(0.1 / math.sqrt(2), rel=0.2)
    assert any("the records do not agree on alpha" in text for text in differing.warnings)
    assert fit_beam(model, first, law).agreements == ()


@pytest.mark.slow
def test_without_damping_none_is_found(model):
    """A fit with a bias towards damping would fail here."""
    found = fit_beam(model, record(model, None, 2), RayleighDamping(alpha=0.3))
    assert found.fit.values[0] < 3 * max(found.fit.errors[0], 0.01) or found.fit.active_bounds[0]


@pytest.mark.slow
def test_modulus_base_amplitude_and_a_sum_of_laws_from_two_records_and_two_markers(model):
    """One record is driven, one released from a load; the guesses of modulus and amplitude are 3 to 4 % off."""
    modes = natural_modes(model, count=2)
    calm = RayleighDamping(beta=3e-4)  # of the higher modes
    truth = ModalDamping(modes, (0.05, 0.03)) + QuadraticDamping(eta2=2.0) + calm
    start = static_equilibrium(model, tip_force=(0.003, 0.0))
    records = [
        record(model, truth, 3, points=(0.1, 0.2)),
        record(model, truth, 4, base=None, start=start, points=(0.2,), duration=0.6),
    ]
    guessed = Model(model.beam.with_(elastic_modulus=1.04 * 264e3))
    records[0] = replace(records[0], base=replace(BASE, amplitude=0.0206))
    guess = ModalDamping(modes, (0.03, 0.03)) + QuadraticDamping(eta2=1.0) + calm
    found = fit_beam(
        guessed,
        records,
        guess,
        unknowns=("elastic_modulus", "base_amplitude"),
        fixed=("ratio2", "beta"),
        tolerance=1e-5,
    )
    assert found.fit.names == ("ratio1", "eta2", "elastic_modulus", "base_amplitude_1")
    assert abs(scores(found, [0.05, 2.0, 264e3, 0.02])).max() < 3.5
    assert np.array(found.model.beam.elastic_modulus) == pytest.approx(264e3, rel=1e-2)
    assert found.fit.errors[3] < 2e-4
    assert "elastic_modulus" in found.report() and found.to_dict()["estimates"][3]["unit"] == "m"


def test_a_ratio_that_refers_to_another_frequency_than_that_of_the_fitted_beam_is_named(model):
    """The true beam is three times as stiff as that of the law."""
    stiffer = Model(model.beam.with_(elastic_modulus=3 * 264e3))
    truth = ModalDamping(natural_modes(stiffer, count=1), (0.05,))
    motion = record(stiffer, truth, 1, base=HarmonicBase(0.01, 2.0, stop=0.5), duration=3.0)
    fit = fit_beam(model, motion, ModalDamping(natural_modes(model, count=1), (0.04,)), unknowns=["elastic_modulus"])
    (note,) = (note for note in fit.warnings if note.startswith("ratio1 refers to"))
    assert float(note.split()[-1]) == pytest.approx(0.05, abs=2 * fit.standard_errors["ratio1"])
    assert abs(fit.estimates["ratio1"] - 0.05) > 2 * fit.standard_errors["ratio1"]


@pytest.mark.slow
def test_an_unknown_start_and_the_damping_are_found(model):
    """A record that begins within a swing, with a guess at rest; two equilibria give the velocity."""
    force, rate = 2e-3, -0.02
    ends = [static_equilibrium(model, tip_force=(force + h * rate, 0.0)).coordinates for h in (1e-3, -1e-3)]
    state = State(static_equilibrium(model, tip_force=(force, 0.0)).coordinates, (ends[0] - ends[1]) / 2e-3)
    cut = record(model, RayleighDamping(alpha=0.8), 7, base=None, start=state, duration=1.0)
    assert np.linalg.norm(state.velocities[-4:-2]) > 0.25  # m/s
    unknown = ("start_force_x", "start_force_x_rate")
    guess = RayleighDamping(alpha=0.5)
    found = fit_beam(model, replace(cut, start="equilibrium"), guess, unknowns=unknown, tolerance=1e-5)
    assert found.fit.names == ("alpha", "start_force_x_1", "start_force_x_rate_1")
    assert found.fit.units == ("1/s", "N", "N/s")
    score = (found.fit.values - [0.8, force, rate]) / found.fit.errors
    assert abs(score).max() < 3.0
    np.testing.assert_array_less(found.fit.errors, [0.1, 0.02 * force, 0.02 * abs(rate)])
    assert found.fit.residual_rms == pytest.approx(NOISE, rel=0.2)
    with pytest.raises(InputError, match="start"):
        found.start(1)
    start = found.start()
    assert abs(start.coordinates - state.coordinates).max() < 0.01
    assert abs(start.velocities - state.velocities)[-4:-2].max() < 0.02
    copy = pickle.loads(pickle.dumps(found))
    assert copy.to_dict() == found.to_dict()
    z = found.fit.values / found.fit.scale
    assert (copy.fit.model(z)[1].full() == found.fit.model(z)[1].full()).all()


@pytest.mark.slow
def test_the_closed_form_is_wrong_where_this_is_right(model):
    """A release from 0.8 L: Eq. (27) mistakes the drag for viscous damping and leaves 7 mm."""
    start, rest = static_equilibrium(model, tip_force=(0.03, 0.0)), static_equilibrium(model)
    assert start.tip[0] > 0.8 * model.beam.length
    calm = RayleighDamping(beta=3e-4)  # of the higher modes
    released = record(model, QuadraticDamping(eta2=0.5) + calm, 5, base=None, start=start, duration=2.0)
    found = fit_beam(model, released, QuadraticDamping(eta2=0.3) + calm, fixed=("beta",), tolerance=1e-5)
    closed = fit_decay(released.time, released.positions[:, 0, 0] - rest.tip[0], law="quadratic", release_time=0.0)
    assert abs(found.fit.values[0] - 0.5) < 3 * found.fit.errors[0] < 0.01
    assert abs(closed.eta2 - 0.5) > 0.4
    assert closed.residual_rms > 10 * found.fit.residual_rms


@pytest.mark.slow
def test_the_right_law_is_selected(model):
    laws = [RayleighDamping(alpha=1.0), QuadraticDamping(eta2=4.0)]
    comparison = compare_laws(model, record(model, QuadraticDamping(eta2=8.0), 6), laws, tolerance=1e-5)
    assert comparison.verdict.best == 1 and comparison.verdict.settled
    assert comparison.best.law.eta2 == pytest.approx(8.0, rel=0.2)
    assert "most probable: QuadraticDamping(eta2)" in comparison.report()
    assert comparison.to_dict()["best"] == "QuadraticDamping(eta2)"


@pytest.mark.slow
def test_friction_is_told_from_drag_and_its_coefficient_recovered(model):
    laws = [QuadraticDamping(eta2=4.0), FrictionDamping(eta0=0.3)]
    comparison = compare_laws(model, record(model, FrictionDamping(eta0=1.0), 6), laws, tolerance=1e-5)
    assert comparison.verdict.best == 1 and comparison.verdict.settled
    assert abs(comparison.best.law.eta0 - 1.0) < 3 * comparison.best.standard_errors["eta0"] < 0.1


def test_laws_that_explain_a_record_equally_are_not_distinguished():
    verdict = judge([Candidate("first", 200, 200.0, 1.00e-3, 1, 0.0), Candidate("second", 200, 200.0, 1.01e-3, 1, 0.0)])
    assert verdict.best == 0 and not verdict.settled
    assert "probabilities: first 0.88, second 0.12" in verdict.warnings[0]
    clear = judge([Candidate("first", 200, 200.0, 1.0e-3, 1, 0.0), Candidate("second", 200, 200.0, 1.2e-3, 1, 0.0)])
    assert clear.settled and not clear.warnings


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.arange(5) / 40.0}, "time: needs at least 10 samples"),
        ({"positions": np.zeros((60, 2))}, r"positions: must have the shape \(61, 1, 2\), got \(60, 1, 2\)"),
        ({"positions": np.full((61, 2), np.nan)}, "positions: must be finite, or nan where a sample is missing"),
        ({"positions": np.full((61, 2), 0.1)}, "positions: are constant; nothing moves"),
        ({"time": np.arange(61)[::-1] / 40.0, "positions": np.eye(61)[:, :2]}, "time: must increase, but sample 2"),
    ],
)
def test_a_record_that_makes_no_sense_is_refused(changes, message):
    usual = {"time": np.arange(61) / 40.0, "positions": np.zeros((61, 2))}
    with pytest.raises(InputError, match=message):
        MarkerRecord(**usual | changes)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"unknowns": ("colour",)}, "unknowns: must be properties of the beam, or among natural_frequencies"),
        ({"unknowns": ("thickness[1:9]",)}, r"thickness\[1:9\]: must name elements from 1 to 3"),
        ({"unknowns": ("excitation",)}, "unknowns: excitation belongs to a kind of record that is not among"),
        ({"unknowns": "width"}, "unknowns: must be a sequence of names"),
        ({"fixed": ("eta3",)}, "fixed: must be one of eta1, eta2, got 'eta3'"),
        ({"fixed": ("eta1", "eta2")}, "unknowns: nothing is to be estimated"),
        ({"bounds": {"beta": (0.0, 1.0)}}, "bounds: unknown key 'beta'; known are "),
        ({"bounds": {"eta1": (1.0, 2.0)}}, "bounds: eta1: the first value 0.6 is not within"),
        ({"bounds": {"eta1": 0.1}}, r"bounds: eta1: must be a pair \(lower, upper\), got 0\.1"),
        ({"bounds": {"eta1": ("a", 1.0)}}, "bounds: eta1: must be numbers"),
        ({"robust": 1e-3}, "robust: must be True or False, got 0.001"),
    ],
)
def test_unknowns_that_make_no_sense_are_refused(model, driven, settings, message):
    with pytest.raises(InputError, match=message):
        fit_beam(model, driven, TRUTH, **settings)


def test_a_load_is_estimated_only_where_a_record_starts_from_an_equilibrium(model, driven):
    with pytest.raises(InputError, match="start: must be an equilibrium if its load"):
        fit_beam(model, replace(driven, start="impact"), TRUTH, unknowns=("start_force_x",))


def test_no_record_or_law_or_a_point_off_the_beam_is_refused(model, driven):
    with pytest.raises(InputError, match=r"records: is empty; give at least one$"):
        fit_beam(model, [], TRUTH)
    with pytest.raises(InputError, match=r"laws: is empty; give at least one DampingLaw"):
        compare_laws(model, driven, [])
    off = MarkerRecord(driven.time, driven.positions, points=(0.3,))
    with pytest.raises(InputError, match="the point must be on the beam"):
        fit_beam(model, off, TRUTH)


def test_guesses_give_the_motion_that_is_simulated_with_them_without_a_fit(model):
    guess, settings = QuadraticDamping(eta1=0.3, eta2=2.0), {"duration": 0.5}
    simulated = record(model, guess, 0, **settings)
    guesses = fitting.compute_guesses(model, record(model, TRUTH, 1, **settings), guess, unknowns=["density"])
    assert {unknown.name: unknown.guess for unknown in guesses.unknowns} == {
        "eta1": 0.3, "eta2": 2.0, "density": 1070.0
    }  # fmt: skip
    noise = NOISE * np.random.default_rng(0).normal(size=simulated.positions.shape)
    for k, channel in enumerate(guesses.records.channels):
        expected = (simulated.positions - noise)[:, 0, k]
        assert channel.predicted == pytest.approx(expected, abs=1e-3 * np.ptp(expected))  # at a coarse tolerance
        assert channel.rms_error > 2 * NOISE  # the guess is not the truth
        assert np.isnan(channel.errors).all()


def test_guesses_that_fail_say_why(model):
    with pytest.raises(InputError, match="nothing is to be estimated"):
        fitting.compute_guesses(model, record(model, TRUTH, 0, duration=0.5))
