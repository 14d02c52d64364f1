"""Fits to records of different kinds at once: each pair recovers the truth, and so do all together."""

import itertools
import math
import pickle
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    PointLoad,
    Sensor,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.estimation.block import Account, Block
from ancf_casadi.estimation.problem import FitProblem
from ancf_casadi.estimation.solve import solve
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.figures.files import figure_bytes
from problems import FrequencyRecord, MarkerRecord, ResponseRecord, StaticRecord, fit_beam
from tests.problems.beam.response_curves import noisy, swept
from tests.problems.beam.truth import ONES, respond, scores

TRUTH = {"elastic_modulus": 210e9, "tip_mass": 5e-4, "clamp_stiffness": 2.0}
RATIO = 0.02
STRIP = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elements": 4}
KINDS = ("decay", "sag", "frequencies", "curve")


def model_of(elastic_modulus, tip_mass, clamp_stiffness, **changes):
    return Model(
        Beam.uniform(
            **STRIP, elastic_modulus=elastic_modulus, tip_mass=tip_mass, clamp_stiffness=clamp_stiffness, **changes
        )
    )


@pytest.fixture(scope="module")
def first():
    """The beam with the first values of its properties."""
    return model_of(205e9, 5.5e-4, 2.4)


@pytest.fixture(scope="module")
def exact(first):
    """Records without noise of the true beam, that of the first model in parentheses where a record holds one."""
    true = model_of(**TRUTH)
    law = ModalDamping(natural_modes(true, count=1), ratios=[RATIO])
    held = static_equilibrium(true, tip_force=(0.01, 0.0))
    run = simulate(true, damping=law, start=held, duration=0.5, sample_rate=60.0)
    down, loads = Sensor("displacement", direction=(0.0, -1.0)), [PointLoad.hung(m, 0.4) for m in (1e-3, 2e-3, 4e-3)]
    level = {"axis": (1.0, 0.0)}
    sag = respond(StaticRecord(model_of(**TRUTH, **level), loads, np.ones(3), down))(ONES)[0]
    frequencies = natural_modes(true, count=3).frequencies
    around = frequencies[0] * np.array([0.97, 0.99, 1.0, 1.01, 1.03])
    record = ResponseRecord(around, np.ones(5), base=HarmonicBase(1e-3, 1.0), sweep="up")
    curve = swept(true, law, record, modes=6)
    lying = Model(first.beam.with_(**level), first.measures)
    start = static_equilibrium(first, tip_force=(0.01, 0.0))
    modes = natural_modes(first, count=1)

    def make(kind, seed):
        rng = np.random.default_rng([seed, KINDS.index(kind)])
        match kind:
            case "decay":
                return MarkerRecord(run.time, run.tip + 2e-4 * rng.standard_normal(run.tip.shape), start=start)
            case "sag":
                return StaticRecord(lying, loads, sag + 1e-4 * rng.standard_normal(3), down, std=1e-4)
            case "frequencies":
                noise = 1 + 1e-3 * rng.standard_normal(3)
                return FrequencyRecord(first, frequencies * noise, std=1e-3 * frequencies)
            case _:
                return noisy(record, curve, rng)

    return make, ModalDamping(modes, ratios=[0.015])


@pytest.fixture(scope="module")
def of_all(first, exact):
    """The fit of all properties to records of all kinds."""
    make, guess = exact
    return fit_beam(first, [make(kind, 1) for kind in KINDS], guess, unknowns=list(TRUTH))


@pytest.mark.slow
def test_all_properties_are_recovered_from_all_records(of_all):
    assert abs(scores(of_all, [RATIO, *TRUTH.values()])).max() < 3.5
    assert of_all.standard_errors["elastic_modulus"] < 0.05 * 210e9


@pytest.mark.slow
@pytest.mark.parametrize("kinds", [*itertools.combinations(KINDS, 2)], ids=" and ".join)
def test_the_modulus_is_recovered_from_every_pair(exact, kinds):
    make, guess = exact
    damped = bool({"decay", "curve"} & set(kinds))
    fit = fit_beam(
        model_of(205e9, TRUTH["tip_mass"], TRUTH["clamp_stiffness"]),
        [_known(make(kind, 1)) for kind in kinds],
        guess if damped else None,
        unknowns=["elastic_modulus"],
    )
    truth = [*([RATIO] if damped else []), TRUTH["elastic_modulus"]]
    assert abs(scores(fit, truth)).max() < 3.5
    assert fit.standard_errors["elastic_modulus"] < 0.05 * 210e9


def _known(record):
    """Return a record whose model has the true tip mass and clamp."""
    known = {name: TRUTH[name] for name in ("tip_mass", "clamp_stiffness")}
    if not isinstance(record, StaticRecord | FrequencyRecord):
        return record
    return record.with_model(Model(record.model.beam.with_(**known), record.model.measures))


@pytest.mark.slow
def test_a_mixed_fit_is_reported_drawn_kept_and_repeated(first, exact, of_all):
    make, _ = exact
    fit, records = of_all, [make(kind, 1) for kind in KINDS]
    text = fit.report()
    assert all(word in text for word in ("integrated at the tolerance", "harmonics", "static test, case 2", "mode 3"))
    assert [account.data["kind"] for account in fit.accounts] == ["motion", "response", "values", "values"]
    assert figure_bytes(fit.figure()).startswith(b"\x89PNG") and len(repr(fit)) < 200
    kept = pickle.loads(pickle.dumps(fit))
    assert kept.intervals() == fit.intervals() and kept.report() == fit.report()
    pair = [records[KINDS.index(kind)] for kind in ("sag", "frequencies")]
    found = fit_beam(first, pair, unknowns=list(TRUTH))
    assert found.refit(pair).estimates == pytest.approx(found.estimates, rel=1e-6)
    for record in records:
        assert fit.predict(record).report()


@pytest.mark.slow
def test_a_prior_counts_as_one_more_measurement(first):
    """A modulus known to 1 % and one measured to s: the variances combine as 1/s^2 + 1/0.01^2."""
    frequencies = natural_modes(first, count=3).frequencies
    record = FrequencyRecord(first, frequencies, std=5e-3 * frequencies)
    free = fit_beam(first, record, unknowns=["elastic_modulus"])
    prior = fit_beam(first, record, unknowns=["elastic_modulus"], priors={"elastic_modulus": (205e9, 2.05e9)})
    alone, both = (fit.standard_errors["elastic_modulus"] for fit in (free, prior))
    assert both == pytest.approx((alone**-2 + 2.05e9**-2) ** -0.5, rel=0.02)
    far = fit_beam(first, record, unknowns=["elastic_modulus"], priors={"elastic_modulus": (210e9, 1e5)})
    assert far.estimates["elastic_modulus"] == pytest.approx(210e9, rel=1e-5)


def test_a_log_normal_prior_weighs_the_logarithm_and_the_report_says_how_far_it_determines_the_unknown(first):
    frequencies = natural_modes(first, count=3).frequencies
    record = FrequencyRecord(first, frequencies, std=5e-3 * frequencies)
    free = fit_beam(first, record, unknowns=["elastic_modulus"])
    alone = free.standard_errors["elastic_modulus"]
    assert not free.fit.data_shares
    held = fit_beam(
        first, record, unknowns=["elastic_modulus"], priors={"elastic_modulus": (205e9, 0.01, "log-normal")}
    )
    assert held.standard_errors["elastic_modulus"] == pytest.approx((alone**-2 + 2.05e9**-2) ** -0.5, rel=0.02)
    share = alone**-2 / (alone**-2 + 2.05e9**-2)
    assert held.fit.data_shares["elastic_modulus"] == pytest.approx(share, rel=0.05)
    assert f"the data determine {held.fit.data_shares['elastic_modulus']:.0%}" in held.report()
    unknown = held.to_dict()["fit"]["unknowns"][0]
    assert unknown["prior"] == pytest.approx((205e9, 2.05e9)) and unknown["data_share"] == pytest.approx(
        share, rel=0.05
    )


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        ((205e9,), "must be a pair .mean, standard deviation., or .median, relative"),
        ((205e9, 0.1, "normal"), "must be one of log-normal"),
        ((-205e9, 0.1, "log-normal"), "must be positive"),
        ((205e9, 0.0, "log-normal"), "must be positive"),
    ],
)
def test_priors_that_are_none_are_refused(first, prior, message):
    record = FrequencyRecord(first, natural_modes(first, count=2).frequencies)
    with pytest.raises(InputError, match=f"priors: elastic_modulus: {message}"):
        fit_beam(first, record, unknowns=["elastic_modulus"], priors={"elastic_modulus": prior})


def test_the_modulus_of_some_elements_is_an_unknown(first):
    """The first two elements are 20 % stiffer; three frequencies tell them from the others."""
    beam = first.beam.with_(elastic_modulus=[1.2 * 205e9] * 2 + [205e9] * 2)
    frequencies = natural_modes(Model(beam), count=4).frequencies
    names = ["elastic_modulus[1:2]", "elastic_modulus[3:4]"]
    fit = fit_beam(first, FrequencyRecord(first, frequencies, std=1e-4 * frequencies), unknowns=names)
    assert [fit.estimates[name] for name in names] == pytest.approx([1.2 * 205e9, 205e9], rel=1e-5)
    assert fit.model.beam.elastic_modulus == pytest.approx(beam.elastic_modulus, rel=1e-5)


def test_a_configuration_with_another_value_of_an_unknown_property_is_refused(first):
    record = FrequencyRecord(first, natural_modes(first, count=3).frequencies, std=0.01)
    fit = fit_beam(first, record, unknowns=["tip_mass"])
    other = Model(first.beam.with_(tip_mass=1e-3))
    assert fit.configured(Model(first.beam.with_(tip_mass=0.0))).beam.tip_mass == 0.0
    for call in (lambda: fit.configured(other), lambda: fit.predict(record.with_model(other))):
        with pytest.raises(InputError, match=r"tip_mass: is 0\.001 kg in this model; it is an unknown of the fit"):
            call()


@pytest.mark.slow
def test_weights_allow_for_the_noise_that_the_fit_absorbs():
    """Two blocks of three values, each with a mean of its own, which absorbs a third of their noise."""
    rng, ratios = np.random.default_rng(0), []
    for _ in range(100):
        noise = rng.standard_normal(6)
        ratios.append(deviation_of(noise))
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.1)


def deviation_of(noise):
    """Return the standard deviation that a block of three values, with a mean of its own, finds in a fit of two."""
    blocks = tuple(Mean(f"mean_{k}", part) for k, part in enumerate(np.split(noise, 2)))
    unknowns = tuple(Unknown(block.name, 0.0) for block in blocks)
    solution = solve(FitProblem(blocks, unknowns))
    return solution.problem.blocks[0].scale


@dataclass(frozen=True, eq=False)
class Mean(Block):
    """Values about an unknown mean."""

    name: str
    values: np.ndarray
    scale: float = 1.0

    lengths = property(lambda self: [[len(self.values)]])
    negligible = 0.0

    def residuals(self, given):
        return (given[self.name] - cs.DM(self.values)) / self.scale

    def reweight(self, residuals, *, robust):
        return replace(self, scale=self.scale * math.sqrt(np.mean(residuals**2)))

    def account(self, fitted):
        return Account()

    def channels(self, fitted):
        return []
