"""Fits of properties: recovery of known truth, coverage, and combinations that the records leave open."""

import math
from functools import cache

import numpy as np
import pytest

from ancf_casadi import Beam, FitError, InputError, Model, PointLoad, Sensor, natural_modes
from ancf_casadi.estimation.result import FitResult
from problems import FrequencyRecord, StaticRecord, fit_beam
from tests.coverage import covers
from tests.problems.beam.truth import FACTORS, ONES, changed, respond

DOWN = Sensor("displacement", 0.45, (0.0, -1.0))
LOADS = [PointLoad.hung(mass, 0.45) for mass in (0.02, 0.05, 0.1, 0.2, 0.4)]


@pytest.fixture(scope="module")
def model_of():
    """The beam of all tests in a configuration; E I = 0.6 N m^2."""

    def make(length=0.5, **changes):
        usual = {"width": 0.03, "thickness": 1.5e-3, "density": 1500.0, "elements": 6, "gravity": (0.0, -9.81)}
        modulus = 0.6 * 12 / (0.03 * 1.5e-3**3)
        return Model(
            Beam.uniform(**{**usual, "length": length, "axis": (1.0, 0.0), "elastic_modulus": modulus, **changes})
        )

    return make


def fitted(records, unknowns, **settings):
    first = records if isinstance(records, StaticRecord | FrequencyRecord) else records[0]
    return fit_beam(first.model, records, unknowns=unknowns, **settings)


@cache
def exact_sag(model):
    return respond(StaticRecord(model, LOADS, np.ones(len(LOADS)), DOWN))(ONES)[0]


@cache
def exact_tones(model, count):
    return respond(FrequencyRecord(model, np.ones(count)))(ONES)[0]


def static(model, truth=None, noise=0.0, seed=0, **settings):
    """Return a static record of a true beam, in the configuration ``model``."""
    ideal = exact_sag(truth or model)
    values = ideal * (1 + noise * np.random.default_rng(seed).standard_normal(len(ideal)))
    return StaticRecord(model, LOADS, values, DOWN, **settings)


def frequencies(model, truth=None, count=2, noise=0.0, seed=0, **settings):
    ideal = exact_tones(truth or model, count)
    values = ideal * (1 + noise * np.random.default_rng(seed + 100_000).standard_normal(count))
    return FrequencyRecord(model, values, **settings)


class TestRecovery:
    @pytest.mark.slow
    @pytest.mark.parametrize("factor", [0.6, 1.7])
    def test_stiffness_and_clamp_from_one_load_deflection_table(self, model_of, factor):
        model = model_of(clamp_stiffness=12.0)
        truth = changed(model, elastic_modulus=factor, clamp_stiffness=2.0)
        fit = fitted(static(model, truth), ["bending_stiffness", "clamp_stiffness"])
        assert fit.estimates["bending_stiffness"] == pytest.approx(0.6 * factor, rel=1e-5)
        assert fit.estimates["clamp_stiffness"] == pytest.approx(24.0, rel=1e-4)
        assert isinstance(fit, FitResult)

    @pytest.mark.slow
    def test_modulus_and_density_from_statics_and_frequencies_of_two_lengths(self, model_of):
        models = model_of(0.5), model_of(0.7)
        records = [static(models[0], changed(models[0], elastic_modulus=1.3, density=0.8))]
        records += [frequencies(m, changed(m, elastic_modulus=1.3, density=0.8)) for m in models]
        fit = fitted(records, ["elastic_modulus", "density"])
        assert fit.estimates["density"] == pytest.approx(0.8 * 1500.0, rel=1e-5)
        assert fit.combinations["bending_stiffness"][0] == pytest.approx(1.3 * 0.6, rel=1e-5)
        assert fit.combinations["mass_per_length"][0] == pytest.approx(0.8 * 1500.0 * 0.03 * 1.5e-3, rel=1e-5)

    @pytest.mark.slow
    def test_the_result_of_a_fit_predicts_another_configuration(self, model_of):
        truth = {"elastic_modulus": 1.2, "clamp_stiffness": 0.5}
        model, other = model_of(clamp_stiffness=20.0), model_of(0.8, clamp_stiffness=20.0, axis=(0.0, -1.0))
        record = static(model, changed(model, **truth), 0.003, std=5e-4)
        fit = fitted(record, ["elastic_modulus", "clamp_stiffness"])
        prediction = fit.predict(frequencies(other, changed(other, **truth)))
        (channel,) = prediction.channels
        assert (np.abs(channel.residuals) < 4 * channel.errors).all()
        assert channel.relative_error < 0.02
        configured = fit.configured(other).beam
        assert configured.elastic_modulus[0] == pytest.approx(fit.estimates["elastic_modulus"])
        assert configured.clamp_stiffness == pytest.approx(fit.estimates["clamp_stiffness"])

    @pytest.mark.slow
    def test_a_configuration_given_with_a_rigid_clamp_gets_the_estimated_stiffness(self, model_of):
        model = model_of(clamp_stiffness=20.0)
        fit = fitted(static(model, changed(model, clamp_stiffness=0.5)), ["clamp_stiffness"])
        for other in (model_of(), model_of(0.8, tip_mass=0.01)):
            assert fit.configured(other).beam.clamp_stiffness == pytest.approx(fit.estimates["clamp_stiffness"])
        assert fit.estimates["clamp_stiffness"] == pytest.approx(10.0, rel=1e-4)

    @pytest.mark.slow
    def test_a_rigid_clamp_is_found_to_be_rigid(self, model_of):
        """The model has no clamp stiffness, so the fit starts from its own first value; E I/L = 1.2 N m."""
        fit = fitted(static(model_of(), noise=0.005, seed=2), ["bending_stiffness", "clamp_stiffness"])
        low, high = fit.intervals()["clamp_stiffness"]
        assert math.isinf(high)
        assert low > 5 * 1.2
        below, above = fit.intervals()["bending_stiffness"]
        assert below < 0.6 < above

    @pytest.mark.slow
    def test_bounds_are_in_si_units_and_hold(self, model_of):
        record = static(model_of(), changed(model_of(), elastic_modulus=1.5))
        fit = fitted(record, ["bending_stiffness"], bounds={"bending_stiffness": (0.5, 0.8)})
        assert fit.estimates["bending_stiffness"] == pytest.approx(0.8)
        assert "bending_stiffness is at its bound 0.8" in fit.warnings[0]


class TestDuality:
    """1 + cos b cosh b = a b (sin b cosh b - cos b sinh b): a = m/(mu L) of a tip mass, or a = E I/(k L) of a clamp."""

    @pytest.mark.slow
    def test_frequencies_cannot_separate_a_tip_mass_from_a_soft_clamp_and_the_fit_says_so(self, model_of):
        models = [model_of(length, gravity=(0.0, 0.0), tip_mass=0.005) for length in (0.3, 0.4, 0.5)]
        records = [frequencies(m, noise=0.005, seed=k) for k, m in enumerate(models)]
        fit = fitted(records, ["elastic_modulus", "tip_mass", "clamp_stiffness"])
        assert len(fit.solution.other_optima) == 1
        assert any("fits as well; the intervals cover both optima" in note for note in fit.warnings)
        intervals = fit.intervals()
        assert intervals["tip_mass"][0] == 0.0
        assert intervals["tip_mass"][1] > 0.005
        assert math.isinf(intervals["clamp_stiffness"][1])
        assert intervals["clamp_stiffness"][0] < 0.6 * 1500.0 * 0.03 * 1.5e-3 / 0.005  # E I mu/m

    @pytest.mark.slow
    def test_a_static_test_separates_them(self, model_of):
        models = [model_of(length, gravity=(0.0, 0.0), tip_mass=0.005) for length in (0.3, 0.4, 0.5)]
        records = [frequencies(m, noise=0.005, seed=k) for k, m in enumerate(models)]
        records.append(static(models[-1], noise=0.005))
        fit = fitted(records, ["elastic_modulus", "tip_mass", "clamp_stiffness"])
        assert fit.solution.other_optima == ()
        low, high = fit.intervals()["tip_mass"]
        assert 0.0 < low < 0.005 < high


class TestUncertainty:
    @pytest.mark.slow
    @pytest.mark.parametrize("stated", [False, True])
    def test_intervals_cover_the_truth_as_often_as_they_say(self, model_of, stated):
        """Also with stated standard deviations, although only a dozen values are left to contradict them."""
        model, hits, runs = model_of(elements=2), 0, 60
        for seed in range(runs):
            table, tones = (make(model, noise=0.01, seed=seed) for make in (static, frequencies))
            if stated:
                table = StaticRecord(model, LOADS, table.measured, DOWN, 0.01 * table.measured)
                tones = FrequencyRecord(model, tones.measured, 0.01 * tones.measured)
            fit = fitted([table, tones], ["bending_stiffness", "density"])
            intervals = fit.intervals()
            for name, true in (("density", 1500.0), ("bending_stiffness", 0.6)):
                hits += intervals[name][0] <= true <= intervals[name][1]
        assert covers(hits, 2 * runs)

    def test_stated_deviations_are_the_least_that_intervals_allow_for(self, model_of):
        exact = static(model_of(), std=1e-3)
        fit = fitted(exact, ["elastic_modulus"])
        _, jacobian = respond(exact)(ONES)
        expected = 1e-3 / np.linalg.norm(jacobian[:, FACTORS.index("elastic_modulus")])
        assert fit.standard_errors["elastic_modulus"] / fit.estimates["elastic_modulus"] == pytest.approx(
            expected, rel=1e-4
        )

    def test_residuals_beyond_the_stated_deviations_widen_the_intervals_with_a_warning(self, model_of):
        record = static(model_of(), noise=0.05, seed=5)
        stated = StaticRecord(model_of(), LOADS, record.measured, DOWN, 0.005 * record.measured)
        fits = [fitted(one, ["elastic_modulus"]) for one in (record, stated)]
        assert fits[1].standard_errors["elastic_modulus"] == pytest.approx(
            fits[0].standard_errors["elastic_modulus"], rel=1e-6
        )
        assert any("times the stated standard deviations" in note for note in fits[1].warnings)

    def test_as_many_values_as_unknowns_give_no_interval_but_a_warning(self, model_of):
        record = StaticRecord(model_of(), LOADS[:1], [0.005], DOWN)
        fit = fitted(record, ["elastic_modulus"])
        assert math.isnan(fit.standard_errors["elastic_modulus"])
        assert any("no more values than unknowns" in note for note in fit.warnings)


class TestOpenCombinations:
    def test_a_table_of_loads_determines_the_bending_stiffness_alone(self, model_of):
        """E b h^3, however the three share it."""
        with pytest.raises(FitError, match=r"determine thickness\*elastic_modulus\^\(1/3\), ") as caught:
            fitted(static(model_of(gravity=(0.0, 0.0))), ["elastic_modulus", "thickness", "width"])
        assert "determine width*thickness^3" in str(caught.value)

    def test_positions_under_the_own_weight_and_frequencies_leave_the_scale_of_mass_and_stiffness_open(self, model_of):
        model = model_of()
        sag = StaticRecord(model, [()], [0.003], Sensor("position", 0.5, (0.0, -1.0)))
        with pytest.raises(FitError, match=r"determine density/elastic_modulus, but not elastic_modulus"):
            fitted([sag, frequencies(model)], ["elastic_modulus", "density"])

    def test_a_known_load_sets_the_scale(self, model_of):
        model = model_of()
        fit = fitted([static(model), frequencies(model)], ["elastic_modulus", "density"])
        assert len(fit.to_dict()["products"]) == 2
        assert max(one["relative_error"] for one in fit.to_dict()["products"]) < 1e-3

    def test_the_clamp_force_sets_the_scale_without_a_load(self, model_of):
        """Two records of the beam at rest under its own weight: its sag, and the force that carries it."""
        model = model_of()
        sensors = [Sensor("position", 0.5, (0.0, -1.0)), Sensor("force", direction=(0.0, 1.0))]
        record = StaticRecord(model, [()], np.ones((1, 2)), sensors)
        exact = respond(record)(ONES)[0]
        rest = StaticRecord(changed(model, elastic_modulus=0.8, density=0.9), [()], exact[None, :], sensors)
        fit = fitted(rest, ["elastic_modulus", "density"])
        assert fit.estimates["density"] == pytest.approx(1500.0, rel=1e-6)
        assert fit.combinations["bending_stiffness"][0] == pytest.approx(0.6, rel=1e-6)


class TestResult:
    @pytest.fixture(scope="class")
    @staticmethod
    def fit(model_of):
        models = model_of(0.5), model_of(0.7)
        noisy = [static(models[0], noise=0.01, name="table"), *(frequencies(m, noise=0.01) for m in models)]
        return fitted(noisy, ["elastic_modulus", "density"])

    def test_report_and_dict_hold_values_intervals_and_records(self, fit):
        text, data = fit.report(), fit.to_dict()
        assert all(name in text for name in ("bending_stiffness", "mass_per_length", "table", "case 5", "mode 2"))
        assert [estimate["name"] for estimate in data["estimates"]] == ["elastic_modulus", "density"]
        assert len(data["records"]) == 3

    def test_the_figure_has_static_tests_and_frequencies_side_by_side(self, fit):
        assert len(fit.figure().axes) == 4
        assert len(fit.predict(fit.solution.problem.blocks[0].record).figure().axes) == 2


class TestInput:
    @pytest.mark.parametrize(
        ("unknowns", "settings", "message"),
        [
            ([], {}, "unknowns: nothing is to be estimated"),
            (["elastic_modulus"] * 2, {}, "unknowns: must be different names"),
            (["stiffness"], {}, "unknowns: must be properties of the beam"),
            (["elastic_modulus", "bending_stiffness"], {}, "unknowns: bending_stiffness changes the same property"),
            (["thickness", "bending_stiffness"], {}, "unknowns: bending_stiffness contains thickness"),
            (["tip_mass"], {}, "tip_mass: no beam has a tip mass"),
            (["elastic_modulus"], {"bounds": {"density": (1.0, 2.0)}}, "bounds: unknown key 'density'"),
            (["elastic_modulus"], {"bounds": {"elastic_modulus": (1.0, 2.0)}}, "the first value"),
            (["elastic_modulus"], {"bounds": {"elastic_modulus": 3.0}}, "bounds: elastic_modulus: must be a pair"),
            (["elastic_modulus"], {"bounds": {"elastic_modulus": (2.0, 1.0)}}, "the first value .* is not within"),
        ],
    )
    def test_unknowns_and_bounds_that_make_no_sense_are_refused(self, model_of, unknowns, settings, message):
        with pytest.raises(InputError, match=message):
            fitted(static(model_of()), unknowns, **settings)

    def test_records_of_different_beams_are_refused(self, model_of):
        records = static(model_of()), frequencies(model_of(thickness=2e-3))
        with pytest.raises(InputError, match=r"records: the records must be of the same beam, .* a thickness from"):
            fitted(records, ["elastic_modulus"])

    def test_either_all_records_or_none_state_their_deviations(self, model_of):
        records = static(model_of(), std=1e-3), frequencies(model_of())
        with pytest.raises(InputError, match="give them for all, or for none"):
            fitted(records, ["elastic_modulus"])


def test_records_of_one_name_are_told_apart_by_number_and_length(model_of):
    records = [frequencies(model_of(length=length)) for length in (0.4, 0.45, 0.5)]
    report = fitted(records, ["elastic_modulus"]).report()
    for text in ("frequencies 1, 0.4 m, ", "frequencies 2, 0.45 m, ", "frequencies 3, 0.5 m, "):
        assert text in report


@pytest.mark.parametrize("factor", [1e-3, 2 * math.pi, 60.0], ids=["kHz", "rad/s", "r/min"])
def test_frequencies_in_another_unit_stand_beside_those_of_the_model(model_of, factor):
    model = model_of()
    measured = natural_modes(model, count=2).frequencies * factor
    notes = fitted(FrequencyRecord(model, measured, std=1e-3 * measured), ["elastic_modulus"]).warnings
    texts = (", ".join(f"{f:.4g}" for f in own) for own in (measured, measured / factor))
    doubt = "the measured frequencies are {} Hz, where the model has {} Hz: give them in Hz".format(*texts)
    assert any(doubt in note for note in notes)


def test_a_fit_that_fails_names_frequencies_in_another_unit(model_of):
    """Far from the frequencies of the model, relative errors hardly depend on the beam."""
    record = FrequencyRecord(model_of(), [6.675e6, 4.183e7], std=[6.675e3, 4.183e4])
    with pytest.raises(FitError, match=r"do not depend on .*; the measured frequencies are 6.675e\+06, 4.183e\+07 Hz"):
        fitted(record, ["elastic_modulus", "clamp_stiffness"])
