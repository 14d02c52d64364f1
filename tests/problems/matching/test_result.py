"""Results of a match: recovered truth, coverage of the deviations, limiting bounds, undetermined properties."""

from dataclasses import replace

import numpy as np
import pytest

from ancf_casadi import Beam, InputError, Model, natural_modes
from problems import (
    FrequencyMatch,
    Global,
    LeastChange,
    MeasuredModes,
    PerElement,
    Smooth,
    Smoothness,
    match_frequencies,
    monte_carlo,
)
from problems.matching.identifiability import Identifiability
from tests.problems.paper import numbers as paper

ELEMENTS = 5
THICKNESS = PerElement("thickness")
GLOBALS = (Global("elastic_modulus"), Global("thickness"), Global("density"))


@pytest.fixture(scope="module")
def beam() -> Beam:
    return Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=210e9, elements=ELEMENTS)


@pytest.fixture(scope="module")
def truth(beam) -> Beam:
    """A beam with a different thickness in each element."""
    change = 0.08 * np.random.default_rng(3).uniform(-1, 1, ELEMENTS)
    return beam.with_(thickness=tuple(0.5e-3 * (1 + change)))


@pytest.fixture(scope="module")
def stocky() -> Beam:
    """Half a metre of steel, 20 mm thick, without gravity."""
    return Beam.uniform(
        length=0.5, width=5e-3, thickness=20e-3, density=8e3, elastic_modulus=210e9, elements=10,
        axis=(1.0, 0.0), gravity=(0.0, 0.0),
    )  # fmt: skip


def measure(truth: Beam, numbers, *, std=1e-4, shape_std=1e-3, noise=None) -> MeasuredModes:
    """Return the modes of a beam as measurements: each shape has its own scale and sign."""
    modes = natural_modes(Model(truth), count=max(numbers) + 1)
    points = tuple(truth.length * np.linspace(0.2, 1.0, 7))
    observer = MeasuredModes((1.0,), points=points, shapes=((1.0,) * 7,)).observer(modes.model)
    shapes = (observer @ modes.shapes[:, numbers]).T
    shapes *= (np.array([1.0, -2.5, 0.1, 7.0])[: len(numbers)] / np.abs(shapes).max(axis=1))[:, None]
    frequencies = modes.frequencies[numbers]
    deviations = std * frequencies, shape_std * np.abs(shapes).max(axis=1)
    if noise is not None:
        frequencies = frequencies + deviations[0] * noise.standard_normal(len(numbers))
        shapes = shapes + deviations[1][:, None] * noise.standard_normal(shapes.shape)
    return MeasuredModes(
        tuple(frequencies), tuple(deviations[0]), points, tuple(map(tuple, shapes)), tuple(deviations[1])
    )


class TestRecovery:
    @pytest.mark.slow
    @pytest.mark.parametrize("seed", [None, 1])
    def test_thicknesses_from_frequencies_and_shapes(self, beam, truth, seed):
        """Four modes in any order and seven points determine five thicknesses, from two starts."""
        start = None if seed is None else (1 + np.random.default_rng(seed).uniform(-0.1, 0.1, ELEMENTS)).tolist()
        match = match_frequencies(beam, targets=measure(truth, [2, 0, 3, 1]), unknowns=(THICKNESS,), guess=start)
        assert match.modes == (3, 1, 4, 2)
        assert match.beam.thickness == pytest.approx(truth.thickness, rel=1e-6)
        assert match.identifiability.rank == ELEMENTS
        assert match.identifiability.spread == pytest.approx(np.column_stack([match.unknowns] * 2))
        assert match.warnings == ()
        assert "The data determine all 5 unknowns." in match.report()

    def test_points_that_were_not_measured_are_left_out(self, beam, truth):
        measured = measure(truth, [0, 1, 2, 3])
        shapes = np.array(measured.shapes)
        shapes[1, 2] = shapes[3, 6] = np.nan
        partly = MeasuredModes(
            measured.frequencies, measured.frequency_std, measured.points, tuple(map(tuple, shapes)), measured.shape_std
        )
        match = match_frequencies(beam, targets=partly, unknowns=(THICKNESS,))
        assert match.beam.thickness == pytest.approx(truth.thickness, rel=1e-6)

    @pytest.mark.slow
    def test_standard_errors_cover_the_truth(self, beam, truth):
        """d' C^-1 d over 16 records is chi-square with 80 degrees of freedom: 80 +- 12.6."""
        total = 0.0
        for seed in range(16):
            measured = measure(truth, [0, 1, 2, 3], noise=np.random.default_rng(seed))
            match = match_frequencies(beam, targets=measured, unknowns=(THICKNESS,))
            d = (np.array(match.beam.thickness) - truth.thickness) / 0.5e-3
            covariance = match.identifiability.covariance
            assert match.identifiability.standard_errors == pytest.approx(np.sqrt(np.diag(covariance)))
            total += d @ np.linalg.solve(covariance, d)
        assert 80 - 3 * 12.6 < total < 80 + 3 * 12.6


class TestLumped:
    @pytest.mark.slow
    def test_tip_mass_and_clamp_stiffness(self, beam):
        """Both from five frequencies and two guesses, up to 40 % off; the clamp stiffness is the least certain."""
        truth = beam.with_(tip_mass=2.6e-3, clamp_stiffness=0.8, elastic_modulus=205e9)
        given_beam = beam.with_(tip_mass=2e-3, clamp_stiffness=1.1)
        targets = natural_modes(Model(truth), count=5).frequencies.tolist()
        unknowns = [Global(name, relative_bounds=0.4) for name in ("tip_mass", "clamp_stiffness", "elastic_modulus")]
        for guess in (None, [0.7, 0.65, 1.3]):
            match = match_frequencies(given_beam, targets=targets, unknowns=unknowns, guess=guess)
            assert match.beam.tip_mass == pytest.approx(2.6e-3, rel=1e-4)
            assert match.beam.clamp_stiffness == pytest.approx(0.8, rel=1e-4)
            assert match.beam.elastic_modulus[0] == pytest.approx(205e9, rel=1e-4)
        assert match.identifiability.rank == 3
        data = match.to_dict()
        assert (data["tip_mass"], data["clamp_stiffness"]) == (match.beam.tip_mass, match.beam.clamp_stiffness)
        assert "N m/rad" in match.report()

    def test_per_element_with_a_mass_at_the_tip(self, beam):
        """The mass belongs to the beam, but is no unknown."""
        heavy = beam.with_(tip_mass=3e-3)
        targets = natural_modes(Model(heavy.with_(thickness=0.51e-3)), count=3).frequencies.tolist()
        match = match_frequencies(heavy, targets=targets, unknowns=(Global("thickness"),))
        assert match.beam.thickness[0] == pytest.approx(0.51e-3, rel=1e-6)
        assert match.beam.tip_mass == 3e-3


class TestCrossing:
    """25 mm instead of 20 mm: bending mode 4 has passed the first axial mode (2562 Hz)."""

    @pytest.mark.slow
    @pytest.mark.parametrize("start", [None, [1.3]])
    def test_bending_modes_are_followed_past_the_axial_one(self, stocky, start):
        measured = measure(stocky.with_(thickness=25e-3), [2, 4])
        match = match_frequencies(
            stocky, targets=measured, unknowns=(Global("thickness", relative_bounds=0.3),), guess=start
        )
        assert match.beam.thickness[0] == pytest.approx(25e-3, rel=1e-6)
        assert match.modes == (3, 5)
        assert match.warnings == ("target 2 is mode 4 of the given beam, and mode 5 of the matched one",)

    def test_without_shapes_the_answer_says_that_modes_crossed(self, stocky):
        """Four bending modes at 25 mm, given as the lowest, although an axial mode is now below the fourth."""
        frequencies = natural_modes(Model(stocky.with_(thickness=25e-3)), count=5).frequencies[[0, 1, 2, 4]]
        match = match_frequencies(
            stocky, targets=frequencies.tolist(), unknowns=(Global("thickness", relative_bounds=0.3),)
        )
        assert match.beam.thickness[0] == pytest.approx(25e-3, rel=1e-6)
        assert any("are not the lowest" in note for note in match.warnings)


class TestOutOfReach:
    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("gravity", "unknowns", "percent"),
        [
            (0.0, (Global("width"), *GLOBALS), 9.48),
            (-9.81, (Global("width"), *GLOBALS), 2.99),
            (0.0, (THICKNESS,), 1.81),
            (0.0, (THICKNESS, Global("density"), Global("elastic_modulus")), 0.95),
            (-9.81, (THICKNESS,), 0.0),
            (-9.81, (PerElement("width"),), 5.51),
        ],
        ids=["uniform", "uniform, hanging", "thickness", "thickness, E, rho", "thickness, hanging", "width, hanging"],
    )
    def test_smallest_worst_error(self, gravity, unknowns, percent):
        """Erratum 3, found without this program: the best of 30 starts there, one start here."""
        standard = paper.standard_beam().with_(gravity=(0.0, gravity))
        match = match_frequencies(
            standard, targets=paper.TARGET_FREQUENCIES, unknowns=unknowns, objective="worst-error"
        )
        assert 100 * match.max_relative_error == pytest.approx(percent, abs=0.006)
        assert match.out_of_reach == (percent > 0)

    def test_the_smallest_worst_error_has_no_standard_errors_but_scatters(self, beam):
        """The least squares of the same targets have a standard error of 0.1 %; the worst error follows mode 5."""
        frequencies = natural_modes(Model(beam), count=5).frequencies
        std = frequencies * [0.001, 0.001, 0.001, 0.02, 0.02]
        targets = MeasuredModes(tuple(frequencies.tolist()), frequency_std=tuple(std.tolist()))
        match = match_frequencies(beam, targets=targets, unknowns=[Global("elastic_modulus")], objective="worst-error")
        assert np.isnan(match.standard_errors["elastic_modulus"]) and np.isnan(match.covariance).all()
        assert np.isnan(match.predict(targets).channels[0].errors).all()
        with pytest.raises(InputError, match=r"^fit: .*monte_carlo"):
            match.profile("elastic_modulus")
        assert monte_carlo(match, runs=8, seed=1).stds[0] > 0.005 * 210e9

    @pytest.mark.slow
    def test_multipliers_say_what_wider_bounds_bring(self, beam):
        """With wider bounds the worst error falls by the sum of the multipliers times the widening, to first order."""
        targets = (natural_modes(Model(beam), count=3).frequencies * [1.05, 0.93, 1.04]).tolist()
        narrow, wide = (
            match_frequencies(beam, targets=targets, unknowns=(THICKNESS,), bounds=bounds, objective="worst-error")
            for bounds in (0.05, 0.0505)
        )
        fall = narrow.max_relative_error - wide.max_relative_error
        assert fall > 1e-5
        assert fall == pytest.approx(0.0005 * narrow.multipliers.sum(), rel=0.05)
        assert {name for name, _ in narrow.holding} <= set(narrow.at_bound)

    @pytest.mark.slow
    def test_least_squares_says_how_far_and_what_holds_it(self, beam):
        targets = (natural_modes(Model(beam), count=3).frequencies * [1.05, 0.93, 1.04]).tolist()
        match = match_frequencies(beam, targets=targets, unknowns=(THICKNESS,), bounds=0.01)
        assert match.out_of_reach
        (note,) = match.warnings
        assert (
            "these unknowns cannot meet the targets: "
            f"a frequency error of {100 * match.max_relative_error:.3g} % remains" in note
        )
        assert f"these bounds keep the beam from fitting better: {match.holding[0][0]}" in note
        assert note in match.report()

    @pytest.mark.slow
    def test_out_of_reach_no_interval_is_given(self, beam):
        """The density is at no bound."""
        targets = (natural_modes(Model(beam), count=3).frequencies * [1.05, 0.93, 1.04]).tolist()
        unknowns = (THICKNESS, Global("density"))
        match = match_frequencies(beam, targets=targets, unknowns=unknowns, bounds=0.01)
        assert "density" not in match.at_bound
        assert [(p["lowest"], p["highest"]) for p in match.to_dict()["properties"]] == [(None, None)] * 6
        assert match.to_dict()["identified"][0].startswith("The targets are out of reach")
        assert "The targets are out of reach" in match.report() and "The data determine" not in match.report()


class TestIdentifiability:
    @pytest.mark.parametrize("gravity", [0.0, -9.81])
    def test_a_uniform_beam_determines_one_product_only(self, beam, gravity):
        beam_ = beam.with_(gravity=(0.0, gravity))
        targets = natural_modes(Model(beam_), count=3).frequencies.tolist()
        match = match_frequencies(beam_, targets=targets, unknowns=(*GLOBALS, Global("width")))
        names, rows = match.identifiability.exponents
        assert names == ("elastic_modulus", "thickness", "density", "width")
        assert rows == pytest.approx(np.array([[1.0, 2.0, -1.0, 0.0]]), abs=1e-6)
        assert "they determine only elastic_modulus thickness^2 density^-1" in match.report()

    def test_spread_of_what_is_traded(self, beam):
        """E h^2 is determined: 10 % of modulus make 5 % of thickness; the width is not, and has its full range."""
        targets = natural_modes(Model(beam), count=3).frequencies.tolist()
        unknowns = (Global("elastic_modulus"), Global("thickness"), Global("width", relative_bounds=0.03))
        spread = match_frequencies(beam, targets=targets, unknowns=unknowns).identifiability.spread
        assert spread == pytest.approx(np.array([[0.9, 1.1], [0.95, 1.05], [0.97, 1.03]]), abs=1e-6)

    def test_spread_bounds_all_beams_that_fit(self, beam):
        """Random moves in the null space of J, up to the bounds, stay within the spread."""
        targets = (natural_modes(Model(beam), count=3).frequencies * [1.02, 0.99, 1.01]).tolist()
        match = match_frequencies(beam, targets=targets, unknowns=(THICKNESS, Smooth("width", terms=2)))
        identifiability, space = match.identifiability, match.matching.space
        assert np.abs(identifiability.jacobian @ identifiability.null_space.T).max() < 1e-8
        rng = np.random.default_rng(4)
        for _ in range(50):
            way = space.map @ (rng.standard_normal(len(identifiability.null_space)) @ identifiability.null_space)
            reach = np.min(
                np.where(way > 0, 1.1 - identifiability.factors, identifiability.factors - 0.9) / np.abs(way)
            )
            moved = identifiability.factors + reach * way
            assert (moved > identifiability.spread[:, 0] - 1e-9).all()
            assert (moved < identifiability.spread[:, 1] + 1e-9).all()
        assert space.size == identifiability.rank + len(identifiability.null_space)

    @pytest.mark.slow
    def test_spread_without_linear_programs_is_that_of_linear_programs(self, beam, monkeypatch):
        targets = (natural_modes(Model(beam), count=3).frequencies * [1.02, 0.99, 1.01]).tolist()
        unknowns = (THICKNESS, Smooth("width", terms=3, relative_bounds=0.05), Global("density"))
        match = match_frequencies(beam, targets=targets, unknowns=unknowns)
        spread = match.identifiability.spread
        assert spread[-1, 0] == pytest.approx(0.9) and (spread[:, 1] > spread[:, 0]).sum() == len(spread)
        monkeypatch.setattr(Identifiability, "_reaches", lambda self, changes: np.zeros(len(changes), bool))
        assert replace(match.identifiability).spread == pytest.approx(spread, abs=1e-7)

    @pytest.mark.slow
    def test_prior_information_gives_errors_to_all(self, beam):
        """One frequency determines E/rho; with prior errors of 10 % of each, 7 % remain."""
        modes = natural_modes(Model(beam.with_(gravity=(0.0, 0.0))), count=1)
        measured = MeasuredModes((float(modes.frequencies[0]),), 1e-5)
        arguments = {"targets": measured, "unknowns": (Global("elastic_modulus"), Global("density"))}
        weightless = beam.with_(gravity=(0.0, 0.0))
        without = match_frequencies(weightless, **arguments).identifiability.standard_errors
        prior = match_frequencies(weightless, preference=LeastChange(weight=100.0), **arguments)
        assert np.isnan(without).all()
        assert prior.identifiability.standard_errors == pytest.approx([0.1 / np.sqrt(2)] * 2, rel=1e-3)

    @pytest.mark.slow
    def test_priors_are_further_measurements(self, beam):
        """One frequency determines the change of E/rho; priors of 1 % and 2 % share it as their variances."""
        weightless = beam.with_(gravity=(0.0, 0.0))
        frequency = 1.003**0.5 * float(natural_modes(Model(weightless), count=1).frequencies[0])
        match = match_frequencies(
            weightless,
            targets=MeasuredModes((frequency,), 1e-5),
            unknowns=(Global("elastic_modulus"), Global("density")),
            priors={"elastic_modulus": (210e9, 0.01, "log-normal"), "density": (8e3, 160.0)},
        )
        assert match.estimates["elastic_modulus"] == pytest.approx(210e9 * 1.003**0.2, rel=1e-5)
        assert match.estimates["density"] == pytest.approx(8e3 * 1.003**-0.8, rel=1e-5)
        common = 0.01 * 0.02 / np.hypot(0.01, 0.02)
        assert match.identifiability.standard_errors == pytest.approx([common, common], rel=0.03)
        shares = match.data_shares
        assert shares == pytest.approx({"elastic_modulus": 0.2, "density": 0.8}, abs=0.02)
        assert "density: the data determine 80%, the prior 20%" in match.report()
        assert [prior["data_share"] for prior in match.to_dict()["priors"]] == list(shares.values())
        for noise, shift in (([0.0, 1.0, 0.0], 0.8 * 0.01), ([0.0, 0.0, 1.0], 0.2 * 0.02)):
            drawn = match.resampled(np.array(noise)) / list(match.estimates.values()) - 1
            assert drawn == pytest.approx([shift, shift], rel=0.03)

    @pytest.mark.parametrize(
        ("priors", "message"),
        [
            ({"priors": {"thickness": (1e-3, 1e-5)}}, "priors: unknown key 'thickness'"),
            ({"priors": {"density": (8e3, 0.0)}}, "priors: density: must be positive"),
            ({"priors": {"density": (8e3, 1.0)}}, "priors: need frequency_std of the targets"),
        ],
    )
    def test_priors_that_cannot_be_used_are_refused(self, beam, priors, message):
        with pytest.raises(InputError, match=message):
            match_frequencies(beam, targets=(1.85,), unknowns=[Global("density")], **priors)

    def test_smoothness_prefers_a_smoother_beam(self, beam):
        targets = (natural_modes(Model(beam), count=2).frequencies * [1.02, 0.99]).tolist()

        def steps(preference) -> float:
            match = match_frequencies(beam, targets=targets, unknowns=(THICKNESS,), preference=preference)
            assert match.max_relative_error < 1e-4
            return float(np.linalg.norm(np.diff(match.beam.thickness)))

        assert steps(Smoothness(weight=1e-6)) < 0.95 * steps(LeastChange(weight=1e-8))

    @pytest.mark.slow
    def test_an_unknown_at_its_bound_is_known_to_the_others(self, beam, truth):
        """With the first element at its bound, the other errors are smaller than with all free; it has none."""
        measured = measure(truth, [0, 1, 2, 3])
        free = match_frequencies(beam, targets=measured, unknowns=(THICKNESS,))
        low = beam.with_(thickness=tuple(np.array(truth.thickness) * [1 / 0.97, 1, 1, 1, 1]))
        match = match_frequencies(low, targets=measured, unknowns=(THICKNESS,), bounds=0.02)
        assert "thickness[1]" in match.at_bound
        errors = match.identifiability.standard_errors
        assert np.isnan(errors[0])
        inner = [k for k in range(ELEMENTS) if f"thickness[{k + 1}]" not in match.at_bound]
        assert (errors[inner] < free.identifiability.standard_errors[inner]).all()

    def test_frequencies_that_the_match_leaves_open_are_predicted_without_standard_errors(self, beam):
        frequencies = natural_modes(Model(beam), count=6).frequencies
        stds = 1e-3 * frequencies
        targets = MeasuredModes(tuple(frequencies[:2].tolist()), frequency_std=tuple(stds[:2].tolist()))
        match = match_frequencies(beam, targets=targets, unknowns=[Smooth("thickness", terms=5)])
        everything = MeasuredModes(tuple(frequencies.tolist()), frequency_std=tuple(stds.tolist()))
        prediction = match.predict(everything)
        assert np.isfinite(prediction.channels[0].errors).tolist() == [True] * 2 + [False] * 4
        assert any("leaves properties open" in note for note in prediction.warnings)


class TestStarts:
    @pytest.mark.slow
    def test_all_starts_reach_the_same_and_processes_change_nothing(self, beam):
        targets = (natural_modes(Model(beam), count=3).frequencies * [0.98, 1.01, 0.99]).tolist()
        serial, parallel = (
            match_frequencies(beam, targets=targets, unknowns=(THICKNESS, Smooth("width")), starts=3, seed=5, jobs=jobs)
            for jobs in (1, 2)
        )
        assert (serial.starts, serial.reached, serial.failed) == (3, 3, 0)
        assert (parallel.unknowns == serial.unknowns).all()
        assert parallel.reached == 3

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"starts": 0}, "starts: must be a whole number, 1 to 10000, got 0"),
            ({"objective": "best"}, "objective: must be one of least-squares, worst-error, got 'best'"),
            ({"preference": 1e-8}, "preference: must be a LeastChange or a Smoothness, got 1e-08"),
        ],
    )
    def test_unusable(self, beam, arguments, message):
        with pytest.raises(InputError, match=message):
            match_frequencies(beam, targets=(1.85,), **arguments)


def test_data_for_json_are_those_of_the_result(beam):
    targets = (natural_modes(Model(beam), count=2).frequencies * [1.02, 0.99]).tolist()
    match = match_frequencies(beam, targets=targets, unknowns=(THICKNESS, Global("density")))
    data = match.to_dict()
    assert isinstance(match, FrequencyMatch)
    assert data["target_hz"] == targets
    assert data["thickness_m"] == list(match.beam.thickness)
    assert [p["name"] for p in data["properties"]] == [*(f"thickness[{i}]" for i in range(1, 6)), "density"]
    assert data["properties"][-1]["value"] == pytest.approx(match.beam.density[0])
    assert data["properties"][-1]["lowest"] < data["properties"][-1]["value"] < data["properties"][-1]["highest"]
    assert data["rank"] == 2


@pytest.mark.parametrize("factor", [1e-3, 2 * np.pi, 60.0], ids=["kHz", "rad/s", "r/min"])
def test_targets_in_another_unit_stand_beside_the_frequencies_of_the_beam(beam, factor):
    standard = natural_modes(Model(beam), count=2).frequencies
    (note,) = match_frequencies(beam, targets=standard * factor).warnings
    texts = (", ".join(f"{f:.4g}" for f in frequencies) for frequencies in (standard * factor, standard))
    assert note.startswith("these unknowns cannot meet the targets: ")
    assert ", and the measured frequencies are {} Hz, where the model has {} Hz: give them in Hz".format(*texts) in note
