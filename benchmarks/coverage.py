"""Coverage of the 95 % intervals of every kind of fit of a beam: the same measurements with other noise, fitted anew.

    .venv/bin/python -m benchmarks.coverage --case joint --seeds 200 --jobs 2

    drag, no-drag     a large motion of a steel strip with and without quadratic damping beside a known modal law
    strip             a large motion of a soft strip with viscous and quadratic damping
    relaxing          modulus and Maxwell branch of a thick, soft beam with a tip mass on a shaken base
    sensors           modulus and damping from four sensors on a released soft strip, 60 samples each, white noise
    sensors-coloured  the same with autoregressive noise, rho = 0.5; sensors-long with 240 samples each
    sensors-mixed     white noise of two sensors, autoregressive noise of the others, rho = 0.5 and 0.8
    mode-1, mode-2    three response curves under modal and quadratic damping; those of mode 2 have jumps
    mass              mass and spring at mid-span from frequencies of two configurations
    ends              stiffness of one end and prestress of a strip between two clamps, from six frequencies
    curvature         natural curvature and modulus from four sags
    suspension        modulus and suspension of a free strip from six frequencies
    clamped           stiffness of one end, prestress and curvature of a strip that two clamps hold level, from decays
                      of two modes and a response curve; clamped-decays without the curve
    joint             a decay, a static test, three frequencies with an added mass and a response curve of one beam

The motions are integrated at 1e-10, so that their own error is negligible, and carry white noise unless the case says
otherwise.  That of response curves is 1 % of the amplitude and 0.01 rad, and 0.1 % of the largest amplitude in both.
The fits know the noise of static tests, frequencies and the cases clamped and joint alone; in the cases that end with
``-understated`` it is twice as large as they know.

Each row has the exact limits (Clopper and Pearson) of the coverage.  The standardised errors, (estimate -
truth)/standard error, are a sharper test: their mean should be 0 within 2/seeds^(1/2), their standard deviation 1.
Without drag the truth is at a bound: half of the estimates should be there, without a standard error, and 97.5 % of the
intervals, which begin there, should cover the truth.

The column ``first order`` is the coverage of the same records if the fit were linear: the residuals and their Jacobian
at the truth give an estimate and its interval without a fit.  A fit that is nearly linear covers with it, record by
record, so that the difference is known far better than either.  ``many`` is the coverage by first order over 4000
draws of white noise with the stated or estimated weights, and ``corrected`` is ``many`` plus the difference, with its
95 % limits: the long-run coverage.  Cases with other noise have no ``many``.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np
from scipy.signal import lfilter
from scipy.stats import binomtest

from ancf_casadi import (
    Beam,
    Clamp,
    DampingLaw,
    HarmonicBase,
    Measurement,
    ModalDamping,
    Model,
    PointLoad,
    PointMass,
    QuadraticDamping,
    RayleighDamping,
    Sensor,
    Spring,
    ViscoelasticDamping,
    natural_modes,
    periodic_motion,
    reduce_model,
    run_all,
    simulate,
    static_equilibrium,
)
from ancf_casadi.estimation.fit import Fit, quantile
from ancf_casadi.estimation.noise.stated import AssumedNoise, residual_noise
from ancf_casadi.support.tables import Table
from benchmarks.beams import DAMPING_RATIOS, silicone, steel
from problems import Channel, FrequencyRecord, MarkerRecord, MotionRecord, ResponseRecord, StaticRecord, fit_beam
from problems.beam.result import BeamFit

PLAIN: dict[str, Any] = {"length": 0.5, "width": 20e-3, "thickness": 1e-3, "density": 2700.0, "elements": 10}
NOISE, FLOOR = 0.01, 1e-3  # of response curves, relative to the amplitude and to the largest amplitude
TIP = Sensor("displacement")
AROUND = np.concatenate([[0.96, 0.98], np.linspace(0.988, 1.012, 9), [1.02, 1.04]])


@dataclass(frozen=True)
class Case:
    """A fit, the true values of its unknowns, and its records with noise from a random generator."""

    model: Model
    guess: DampingLaw | None
    truth: Mapping[str, float]
    records: Callable[[np.random.Generator], Any]
    settings: Mapping[str, Any] = field(default_factory=dict)
    white: bool = True  # whether the noise is white, and as stated where it is stated


@lru_cache
def case(name: str) -> Case:
    """Return a case by name."""
    return CASES[name]()


def drag(eta2: float) -> Case:
    """Return a motion of a steel strip at its resonance; only drag is unknown."""
    model = Model(steel(5))
    modes = natural_modes(model, count=5)
    law, base = ModalDamping(modes, DAMPING_RATIOS), HarmonicBase(1e-3, modes.frequencies[0], stop=4.0)
    records = motion(model, law + QuadraticDamping(eta2=eta2) if eta2 else law, base, 1.0, 500.0, 2e-5)
    fixed = tuple(own.name for own in law.parameters)
    return Case(model, law + QuadraticDamping(eta2=0.1), {"eta2": eta2}, records, {"fixed": fixed})


def strip() -> Case:
    """Return a motion of a soft strip."""
    model = Model(silicone(5))
    records = motion(model, QuadraticDamping(0.6, 4.0), HarmonicBase(0.02, 2.0, stop=0.5), 1.5, 40.0, 0.5e-3)
    return Case(model, QuadraticDamping(0.3, 8.0), {"eta1": 0.6, "eta2": 4.0}, records)


def relaxing() -> Case:
    """Return a motion of a thick, soft beam whose material relaxes."""
    truth, base = {"modulus1": 0.25, "time1": 0.034, "elastic_modulus": 240e3}, HarmonicBase(5e-3, 4.0, stop=0.5)

    def thick(modulus: float) -> Model:
        return Model(
            silicone(
                3, length=0.1, width=0.03, thickness=0.03, tip_mass=0.052, elastic_modulus=modulus, axis=(0.0, -1.0)
            )
        )

    records = motion(thick(240e3), ViscoelasticDamping([0.25], [0.034]), base, 2.0, 100.0, 0.2e-3)
    settings = {"unknowns": ["elastic_modulus"], "bounds": {"elastic_modulus": (180e3, 330e3)}}
    return Case(thick(260e3), ViscoelasticDamping([0.15], [0.05]), truth, records, settings)


def motion(
    model: Model, law: DampingLaw, base: HarmonicBase, duration: float, sample_rate: float, noise: float
) -> Callable[[np.random.Generator], MarkerRecord]:
    """Return a measured motion of the tip as a function of a random generator."""
    settings: dict[str, Any] = {"duration": duration, "sample_rate": sample_rate, "tolerance": 1e-10}
    run = simulate(model, damping=law, base=base, method="radau", **settings)
    return lambda rng: MarkerRecord(run.time, run.tip + noise * rng.normal(size=run.tip.shape), base=base)


def sensors(samples: int, colours: tuple[float, ...]) -> Case:
    """Return a released motion of a soft strip, seen by four sensors with autoregressive noise of each coefficient."""
    truth = {"alpha": 1.0, "elastic_modulus": 264e3}
    beam, law = silicone(2), RayleighDamping(alpha=truth["alpha"])
    beams = beam, beam.with_(elastic_modulus=250e3)
    start, guess = (static_equilibrium(Model(one), tip_force=(2e-3, 0.0)) for one in beams)
    run = simulate(
        Model(beam),
        damping=law,
        start=start,
        duration=samples / 120,
        sample_rate=120.0,
        method="radau",
        tolerance=1e-10,
    )
    kinds = [  # sensor, exact readings, noise
        (Sensor("displacement", point=0.15), run.position(0.15)[:, 0], 5e-4),
        (Sensor("displacement", point=0.2, direction=(0.0, 1.0)), run.tip[:, 1], 5e-4),
        (Sensor("velocity", point=0.2), run.velocity(0.2)[:, 0], 1e-2),
        (Sensor("velocity", point=0.1, direction=(0.0, 1.0)), run.velocity(0.1)[:, 1], 5e-3),
    ]

    def records(rng: np.random.Generator) -> MotionRecord:
        channels = []
        for (sensor, exact, size), rho in zip(kinds, colours, strict=True):
            noise = lfilter([(1 - rho**2) ** 0.5], [1.0, -rho], rng.normal(size=500 + len(exact)))[500:]
            channels.append(Channel(Measurement(run.time, exact + size * noise, sensor=sensor)))
        return MotionRecord(channels, start=guess)

    settings = {"unknowns": ["elastic_modulus"]}
    return Case(guess.model, RayleighDamping(alpha=0.8), truth, records, settings, white=not any(colours))


def resonance(mode: int, ratio: float, eta2: float, levels: tuple[float, ...]) -> Case:
    """Return response curves about a mode; of the ratios, only that of this mode is unknown."""
    model = Model(steel(8))
    modes = natural_modes(model, count=mode)
    law = ModalDamping(modes, (0.01,) * (mode - 1) + (ratio,)) + QuadraticDamping(eta2=eta2)
    bases = [HarmonicBase(level, 1.0) for level in levels]
    truths = [response(model, law, modes.frequencies[-1] * AROUND, base) for base in bases]
    truth = {f"ratio{mode}": ratio, "eta2": eta2, f"frequency_{mode}": 1.0}
    fixed = tuple(f"ratio{k}" for k in range(1, mode))
    settings = {"fixed": fixed, "modes": 4, "harmonics": 5}
    return Case(model, law, truth, lambda rng: [one(rng) for one in truths], settings)


def response(
    model: Model,
    law: DampingLaw,
    frequencies: np.ndarray,
    base: HarmonicBase,
    *,
    stated: bool = False,
    sensor: Sensor = TIP,
) -> Callable[[np.random.Generator], ResponseRecord]:
    """Return a response curve of a displacement as a function of a random generator.

    If ``stated``, the record holds the standard deviations.
    """
    reduced = reduce_model(model, modes=8, damping=law)
    motions = [periodic_motion(reduced, base=replace(base, frequency=f)) for f in frequencies]
    harmonics = [motion.harmonics(sensor.point, direction=sensor.direction, relative=False) for motion in motions]
    values = np.array([first for _, first, *_ in harmonics])
    spread = np.hypot(NOISE, FLOOR * abs(values).max() / abs(values))

    def record(rng: np.random.Generator) -> ResponseRecord:
        size, angle = rng.standard_normal((2, len(values))) * spread
        noise = {"amplitude_std": spread * abs(values), "phase_std": spread} if stated else {}
        noisy = values * (1 + size) * np.exp(1j * angle)
        return ResponseRecord(frequencies, noisy, sensor=sensor, base=base, **noise)

    return record


def joint() -> Case:
    """Return four kinds of measurement of a strip in an elastic clamp, with a mass at the tip for the frequencies."""
    truth = {"eta2": 1.0, "elastic_modulus": 210e9, "tip_mass": 0.5e-3, "clamp_stiffness": 0.4}
    beam = steel(4, clamp_stiffness=truth["clamp_stiffness"])
    first = beam.with_(elastic_modulus=[200e9] * 4, clamp_stiffness=0.5)
    model, guess, law, pull = Model(beam), Model(first), QuadraticDamping(0.5, truth["eta2"]), (2e-3, 0.0)

    run = simulate(
        model, damping=law, start=static_equilibrium(model, tip_force=pull), duration=0.6, sample_rate=50.0,
        method="radau", tolerance=1e-10,
    )  # fmt: skip
    weights = [PointLoad.hung(mass, point=0.4) for mass in (1e-3, 2e-3, 4e-3)]  # kg
    down, level = Sensor("displacement", direction=(0.0, -1.0)), Model(beam.with_(axis=(1.0, 0.0)))
    rest = level.interpolation(0.5) @ static_equilibrium(level).coordinates
    held = [level.interpolation(0.5) @ static_equilibrium(level, loads=[one]).coordinates for one in weights]
    sag = np.array([(rest - one)[1] for one in held])
    frequencies = natural_modes(Model(beam.with_(tip_mass=truth["tip_mass"])), count=3).frequencies
    resonant = natural_modes(model, count=1).frequencies[0] * np.array([0.97, 0.99, 1.0, 1.01, 1.03])
    curve = response(
        model, law, resonant, HarmonicBase(0.5e-3, 1.0), stated=True
    )  # five points do not show their noise

    def records(rng: np.random.Generator) -> list[Any]:
        noisy = frequencies * (1 + 1e-3 * rng.normal(size=3))
        tip = run.tip + 2e-4 * rng.normal(size=run.tip.shape)
        return [
            MarkerRecord(run.time, tip, start=static_equilibrium(guess, tip_force=pull)),
            StaticRecord(
                Model(first.with_(axis=(1.0, 0.0))), weights, sag + 1e-4 * rng.normal(size=3), down,
                std=1e-4,
            ),
            FrequencyRecord(Model(first.with_(tip_mass=0.6e-3)), noisy, std=1e-3 * frequencies),
            curve(rng),
        ]  # fmt: skip

    names = ["elastic_modulus", "tip_mass", "clamp_stiffness"]
    settings = {"unknowns": names, "fixed": ("eta1",), "modes": 3, "harmonics": 3}
    return Case(guess, QuadraticDamping(0.5, 0.7), truth, records, settings)


def plain(modulus: float = 70e9, **options: Any) -> Beam:
    """Return a strip of aluminium, by default lying without gravity."""
    given = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0)} | options
    return Beam.uniform(**PLAIN | given, elastic_modulus=modulus)


def tones(
    true: Beam, first: Beam, count: int, understated: float, relative: float = 2e-3
) -> Callable[[np.random.Generator], FrequencyRecord]:
    """Return the frequencies of a beam with relative noise as a record of another one."""
    exact = natural_modes(Model(true), count=count).frequencies
    exact = exact[exact > 0.0]

    def record(rng: np.random.Generator) -> FrequencyRecord:
        measured = exact * (1 + understated * relative * rng.standard_normal(exact.size))
        return FrequencyRecord(Model(first), measured, std=relative * measured)

    return record


def mass(understated: float) -> Case:
    """Return four frequencies each of a strip and of the strip with a tip mass; mass and spring at mid-span."""
    truth = {"mass": 12e-3, "spring_y": 900.0}

    def beams(m: float, k: float) -> tuple[Beam, Beam]:
        parts = [PointMass(0.25, m), Spring(0.25, (0.0, k))]
        return plain(attachments=parts), plain(attachments=parts, tip_mass=8e-3)

    first = beams(9e-3, 1200.0)
    pairs = [tones(one, own, 4, understated) for one, own in zip(beams(*truth.values()), first, strict=True)]
    return Case(
        Model(first[0]),
        None,
        truth,
        lambda rng: [one(rng) for one in pairs],
        {"unknowns": [*truth]},
        white=understated == 1.0,
    )


def ends(understated: float) -> Case:
    """Return six frequencies of a strip between two clamps under prestress, of which the second is elastic."""
    truth = {"clamp_stiffness": 2.0, "prestress": 2e6}

    def clamped(k: float, prestress: float) -> Beam:
        return plain(supports=[Clamp(0.0), Clamp(0.5, k)], prestress=prestress)

    first = clamped(4.0, 1e6)
    record = tones(clamped(*truth.values()), first, 6, understated, relative=5e-4)
    return Case(Model(first), None, truth, record, {"unknowns": [*truth]}, white=understated == 1.0)


def curvature(understated: float) -> Case:
    """Return the rest positions of the tip without and under three weights."""
    truth, gravity = {"natural_curvature": 0.4, "elastic_modulus": 70e9}, (0.0, -9.81)
    beam, first = (plain(e, gravity=gravity, natural_curvature=c) for e, c in ((70e9, 0.4), (80e9, 0.3)))
    cases = [[], *([PointLoad.hung(mass)] for mass in (20e-3, 40e-3, 60e-3))]
    sags = np.array([static_equilibrium(Model(beam), loads=loads).tip[1] for loads in cases])
    height, noise = Sensor("position", direction=(0.0, 1.0)), 0.2e-3

    def record(rng: np.random.Generator) -> StaticRecord:
        measured = sags + understated * noise * rng.standard_normal(4)
        return StaticRecord(Model(first), [case or [PointLoad()] for case in cases], measured, height, std=noise)

    return Case(Model(first), None, truth, record, {"unknowns": [*truth]}, white=understated == 1.0)


def suspension(understated: float) -> Case:
    """Return six frequencies of a free strip on two soft springs."""
    truth = {"elastic_modulus": 70e9, "spring_stiffness": 20.0}

    def free(modulus: float, k: float) -> Beam:
        return plain(modulus, supports=[], attachments=[Spring(s, (k, k)) for s in (0.112, 0.388)])

    first = free(60e9, 40.0)
    return Case(
        Model(first),
        None,
        truth,
        tones(free(*truth.values()), first, 6, understated),
        {"unknowns": [*truth]},
        white=understated == 1.0,
    )


def clamped(*, curve: bool) -> Case:
    """Return the decays of two modes and, if wanted, a response curve of a coiled strip that two clamps hold level."""
    truth, law = {"clamp_stiffness": 0.1, "prestress": 2e5, "natural_curvature": 0.3}, RayleighDamping(alpha=6.0)
    places, across, noise = (0.125, 0.25), (0.0, 1.0), 5e-6

    def level(k: float, prestress: float, bend: float) -> Model:
        coiled = Model(plain(elements=4, natural_curvature=bend, prestress=prestress))
        (x, y), (c, s) = (part[-1].tolist() for part in coiled.natural_nodes)
        far = Clamp(0.5, k, displacement=(0.5 - x, -y), rotation=-np.arctan2(s, c))
        return Model(coiled.beam.with_(supports=[Clamp(0.0), far]))

    model, first = level(*truth.values()), level(0.12, 1.5e5, 0.29)
    frequencies, runs = natural_modes(model, count=2).frequencies, []
    for f, periods in zip(frequencies, (10, 15), strict=True):
        base = HarmonicBase(1e-4, f, stop=3 / f, direction=across)
        settings = {"duration": periods / f, "sample_rate": 8 * f, "tolerance": 1e-10}
        runs.append((base, simulate(model, damping=law, base=base, method="radau", **settings)))
    resonant, middle = frequencies[0] * np.array([0.9, 0.95, 1.05, 1.2]), Sensor("displacement", places[1], across)
    driven = HarmonicBase(5e-5, 1.0, direction=across)
    measured = response(model, law, resonant, driven, stated=True, sensor=middle) if curve else None

    def records(rng: np.random.Generator) -> list[Any]:
        found: list[Any] = []
        for base, run in runs:
            channels = [
                Channel(Measurement(run.time, run.position(s)[:, 1] + noise * rng.standard_normal(len(run.time)),
                                    sensor=Sensor("position", s, across)), std=noise) for s in places
            ]  # fmt: skip
            found.append(MotionRecord(channels, base=base, start=static_equilibrium(first)))
        return found + ([measured(rng)] if measured else [])

    settings = {"unknowns": [*truth], "fixed": ("alpha",), "modes": 2, "harmonics": 3}
    return Case(first, law, truth, records, settings)


CASES: Mapping[str, Callable[[], Case]] = {
    "drag": partial(drag, 0.2),
    "no-drag": partial(drag, 0.0),
    "strip": strip,
    "relaxing": relaxing,
    "sensors": partial(sensors, 60, (0.0, 0.0, 0.0, 0.0)),
    "sensors-coloured": partial(sensors, 60, (0.5, 0.5, 0.5, 0.5)),
    "sensors-mixed": partial(sensors, 60, (0.0, 0.5, 0.0, 0.8)),
    "sensors-long": partial(sensors, 240, (0.5, 0.5, 0.5, 0.5)),
    "mode-1": partial(resonance, 1, 0.006, 1.0, (0.5e-3, 2e-3, 6e-3)),
    "mode-2": partial(resonance, 2, 0.003, 0.3, (0.05e-3, 0.1e-3, 0.2e-3)),
    **{f"{one.__name__}{end}": partial(one, factor) for one in (mass, ends, curvature, suspension)
       for end, factor in (("", 1.0), ("-understated", 2.0))},
    "clamped": partial(clamped, curve=True),
    "clamped-decays": partial(clamped, curve=False),
    "joint": joint,
}  # fmt: skip


def study(name: str, seed: int) -> np.ndarray:
    """Return three numbers for each unknown, (n, 3).

    They are whether its interval covers the truth, its standardised error, and whether the interval to first order
    covers the truth; the last is nan if the truth is at a bound.
    """
    one = case(name)
    fit = fitted(name, seed)
    found, errors, intervals = fit.estimates, fit.standard_errors, fit.intervals()
    linear = FirstOrder.of(fit, one.truth)
    first = linear.covered(linear.residuals)
    return np.array([
        (intervals[unknown][0] <= true <= intervals[unknown][1], (found[unknown] - true) / errors[unknown], hit)
        for (unknown, true), hit in zip(one.truth.items(), first, strict=True)
    ])  # fmt: skip


def fitted(name: str, seed: int) -> BeamFit:
    """Return the fit to the records of a seed."""
    one = case(name)
    return fit_beam(one.model, one.records(np.random.default_rng(seed)), one.guess, **one.settings)


@dataclass(frozen=True)
class FirstOrder:
    """A fit linearised at the truth: residuals r (m,), Jacobian J (m, n), and how their noise is found."""

    residuals: np.ndarray
    jacobian: np.ndarray
    places: list[int]  # of the unknowns with a true value
    inside: bool  # whether no true value is at a bound
    size: float  # standard deviation of residuals that are as stated
    fit: Fit
    stated: np.ndarray

    @classmethod
    def of(cls, result: BeamFit, truth: Mapping[str, float]) -> FirstOrder:
        """Return the fit linearised at the true values; unknowns without one keep their estimates."""
        fit, problem = result.solution.fit, result.solution.problem
        values = np.array([truth.get(one.name, result.estimates[one.name]) for one in fit.unknowns])
        bounds = np.array([(one.lower, one.upper) for one in fit.unknowns])
        inside = bool(np.all((values > bounds[:, 0]) & (values < bounds[:, 1])))
        places = [fit.names.index(name) for name in truth]
        stated = np.repeat([block.stated for block in problem.blocks], [sum(block.series) for block in problem.blocks])
        if inside:
            residuals, jacobian = map(np.asarray, fit.model(fit.coordinates.at(values) / fit.scale))
        else:
            residuals, jacobian = fit.residuals, fit.jacobian * fit.scale
        return cls(residuals.ravel(), jacobian, places, inside, problem.scale, fit, stated)

    @cached_property
    def basis(self) -> tuple[np.ndarray, np.ndarray]:
        """The factors q (m, n) and (n, n) of J."""
        return np.linalg.qr(self.jacobian)

    def covered(self, noise: np.ndarray) -> list[float]:
        """Return whether the interval of each unknown covers the truth, for residuals (m,) there; nan at a bound."""
        if not self.inside:
            return [math.nan] * len(self.places)
        q, triangle = self.basis
        along, inverse = q.T @ noise, np.linalg.inv(triangle)
        found = residual_noise(
            noise - q @ along, q, AssumedNoise(self.fit.series, self.fit.times, self.stated, self.size)
        )
        errors = np.sqrt(np.diag(inverse @ found.form(q) @ inverse.T))
        hits = np.abs(inverse @ along) <= quantile(0.95, found.freedom) * errors
        return [float(hits[place]) for place in self.places]


def coverage(name: str, seeds: range, *, executor: Executor | None = None, jobs: int = 1) -> Table:
    """Return the coverage of the intervals of each unknown of a case, one row each."""
    tasks = [partial(study, name, seed) for seed in seeds]
    found = np.array(run_all(tasks, executor=executor, jobs=jobs, progress=True))
    rows, many = [], np.full(len(case(name).truth), math.nan)
    if case(name).white and np.isfinite(found[:, :, 2]).all():
        linear, rng = FirstOrder.of(fitted(name, seeds[0]), case(name).truth), np.random.default_rng(0)
        draws = linear.size * rng.standard_normal((4000, len(linear.residuals)))
        many = np.mean([linear.covered(draw) for draw in draws], axis=0)
    for k, unknown in enumerate(case(name).truth):
        hits, scores, first = int(found[:, k, 0].sum()), found[:, k, 1], found[:, k, 2]
        limits, known = binomtest(hits, len(seeds)).proportion_ci(), scores[np.isfinite(scores)]
        differences = found[:, k, 0] - first
        error = 1.96 * (np.count_nonzero(differences) + 1) ** 0.5 / len(seeds)  # one more than seen, so not 0
        rows.append((
            name, unknown, hits, len(seeds), f"{100 * hits / len(seeds):.1f}",
            f"{100 * limits.low:.1f} to {100 * limits.high:.1f}", len(seeds) - len(known),
            f"{known.mean():.2f}", f"{known.std(ddof=1):.2f}", f"{100 * first.mean():.1f}", f"{100 * many[k]:.1f}",
            f"{100 * (many[k] + differences.mean()):.1f} +- {100 * error:.1f}",
        ))  # fmt: skip
    columns = ("case", "unknown", "covered", "seeds", "%", "limits", "at bound", "mean", "deviation",
               "first order", "many", "corrected")  # fmt: skip
    return Table("coverage", "Coverage of 95 % intervals", columns, rows)


def main() -> None:
    """Run the study, and print a table for each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", choices=tuple(CASES), action="append", help="all if not given")
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    for name in options.case or CASES:
        print(coverage(name, range(options.first, options.first + options.seeds), jobs=options.jobs).text(), flush=True)


if __name__ == "__main__":
    main()
