"""Frequency and damping from measured free decays, Eq. (10).

With a free decay r under a damping law and a frequency law (``laws``), and a rest position d (``rest``), the fit to the
measured values y_i at the times t_i after the release is

    minimise    R = (1/m sum_i (r(t_i) + d(t_i) - y_i)^2)^1/2

over the unknowns of the laws and of d.  If velocity or acceleration was measured, r is replaced by
its derivative.  Several records of the same mode are fitted at once: they share the unknowns of the mode, and each has
its own amplitude, phase and rest position; their noise is assumed to be equal.  ``solution`` solves the problem.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 and 4.2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import NoneType
from typing import Any, Literal, get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.rest_position import Rest
from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.estimation.solver.unknown import Priors
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import check_instance, choice, flag, instances, numbers
from ancf_casadi.support.interrupts import lasting_interrupts
from problems.decay.amplitudes import AmplitudeFit, AmplitudeLaw, fit_amplitudes
from problems.decay.comparison import combinations, compare_decay_laws, compare_models, comparison_arguments
from problems.decay.free_decay import as_record, clean_record, cut_at_release
from problems.decay.laws import RATIO_BOUNDS, DecayModel, Law
from problems.decay.limitations import refuse_unexplained
from problems.decay.result import DecayFit
from problems.decay.solution import fit_one_mode
from problems.decay.takes import DecayFits


@overload
def fit_decay(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    quantity: Literal["amplitude"],
    frequency: float | None = None,
    law: AmplitudeLaw = "linear",
    robust: bool = False,
) -> AmplitudeFit: ...


@overload
def fit_decay(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    law: Law | Literal["auto"] = "linear",
    frequency_law: FrequencyLaw | Literal["auto"] | None = None,
    rest: Rest | Literal["auto"] | None = None,
    release_time: float | None = None,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
    priors: Priors | None = None,
    robust: bool = False,
    quantity: Literal["motion"] = "motion",
    frequency: None = None,
) -> DecayFit: ...


@lasting_interrupts()
def fit_decay(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    law: Law | Literal["auto"] = "linear",
    frequency_law: FrequencyLaw | Literal["auto"] | None = None,
    rest: Rest | Literal["auto"] | None = None,
    release_time: float | None = None,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
    priors: Priors | None = None,
    robust: bool = False,
    quantity: Literal["motion", "amplitude"] = "motion",
    frequency: float | None = None,
) -> DecayFit | AmplitudeFit:
    """Fit a free decay.

    Parameters
    ----------
    time : array_like or Measurement
        Times, s, increasing; or the whole record.
    displacement : array_like
        Displacement at each time, m.
    law : {"linear", "quadratic", "friction", "power", "smooth", "auto"}
        ``linear``: Eq. (9).  ``quadratic``: Eq. (27).  ``friction``: Eq. (27) with friction as a third term.
        ``power``: a force ``eta_p |v|^p`` with a free exponent p.  ``smooth``: a smooth damping ratio of the amplitude,
        without a law.  ``auto``: the most probable of ``compare_decay_laws``, which does not try the smooth one; a
        warning names the others if its probability is below 95 %.
    frequency_law : {"constant", "linear", "quadratic", "power", "logarithmic", "smooth", "auto"}, optional
        Change of the frequency f with the amplitude A: none, f (1 + k A), f (1 + k A^2), f (1 + k A^q),
        f (1 + k ln(1 + A/A_s)), a smooth function without a law, or the best of ``compare_decay_laws``, which does not
        try the smooth one.  If not given, constant; with the law ``auto`` the best.
    rest : {"zero", "constant", "drift", "creep", "auto"}, optional
        Rest position: 0, constant, d + v t, d + v (1 - exp(-k t))/k with the rate k (``creep``), or the best of
        ``compare_decay_laws``.  If not given, constant; with the law ``auto`` the best.
    release_time : float, optional
        Start of the free decay, s; detected in the record if not given.
    ratio_bounds : (float, float)
        Bounds of the damping ratio under the linear law, above -1 and below 1; not with amplitudes.
    priors : mapping, optional
        What is known of an unknown before the fit, by its name in ``fit.fit.names``, or as ``damping_ratio`` (linear
        law), ``frequency`` (Hz; constant law) or ``frequency_at_zero`` (Hz, at zero amplitude; linear, quadratic or
        power law): mean and standard deviation, or median, relative standard deviation and ``"log-normal"``:
        ``{"frequency": (1.91, 0.01)}``.  Not with ``auto``.
    robust : bool
        Whether to use the pseudo-Huber loss, which limits the influence of outliers.
    quantity : {"motion", "amplitude"}
        What the record holds: the oscillation, or its amplitudes over time, as read off a screen or by a lock-in
        amplifier, under one of the first four laws.  The result is then an ``AmplitudeFit``.
    frequency : float, optional
        Natural frequency of amplitudes, Hz, for a damping ratio; without it, the rates of decay follow.

    Raises
    ------
    InputError
        If the record is not usable, nothing in it oscillates, or an option is unknown.
    FitError
        If the fit does not converge.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import fit_decay
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise)
    >>> fit = fit_decay(record)
    >>> print(f"{fit.frequency:.3f} Hz, {100 * fit.damping_ratio:.2f} %")
    1.910 Hz, 0.83 %
    >>> fit.warnings
    ()
    >>> amplitudes = [20.0, 16.2, 13.5, 11.0, 8.9, 7.4]  # read off a screen
    >>> read_off = fit_decay([0, 2, 4, 6, 8, 10], amplitudes, quantity="amplitude", frequency=1.91)
    >>> print(f"{100 * read_off.estimates['damping_ratio']:.2f} %")
    0.83 %
    """
    choice(quantity, ("motion", "amplitude"), "quantity")
    if quantity == "amplitude":
        bounds = None if np.array_equal(ratio_bounds, RATIO_BOUNDS) else ratio_bounds
        unused = {"frequency_law": frequency_law, "rest": rest, "release_time": release_time, "priors": priors,
                  "ratio_bounds": bounds}  # fmt: skip
        for name, value in unused.items():
            if value is not None:
                raise InputError("does not go with amplitudes over time; leave it out", name)
        return fit_amplitudes(as_record(time, displacement), law, frequency, robust=flag(robust, "robust"))
    if frequency is not None:
        raise InputError(
            "belongs to quantity='amplitude'; the oscillation shows it, and priors may state it", "frequency"
        )
    choice(law, (*get_args(Law), "auto"), "law")
    choice("constant" if frequency_law is None else frequency_law, (*get_args(FrequencyLaw), "auto"), "frequency_law")
    choice("constant" if rest is None else rest, (*get_args(Rest), "auto"), "rest")
    check_instance(priors, "priors", Mapping, NoneType)
    robust = flag(robust, "robust")
    models = combinations(**comparison_arguments(law, frequency_law, rest), ratio_bounds=ratio_bounds)
    if len(models) > 1 and (robust or priors):
        argument = "robust=True" if robust else "priors"
        raise InputError(f"compares sums of squares; name a law, or leave out {argument}", "auto")
    record = clean_record(time, displacement)
    decay = cut_at_release(record, release_time)
    if len(models) == 1:
        (fit,) = fit_one_mode([decay], models[0], robust=robust, priors=dict(priors or {}))
    else:
        comparison = compare_models(decay, models)
        fit, choice_warning = comparison.best, () if comparison.verdict.settled else comparison.verdict.warnings[:1]
        fit = replace(fit, decay=replace(fit.decay, notes=(*fit.notes, *choice_warning)))
    refuse_unexplained(fit)
    return fit


def fit_or_compare(
    record: Measurement, laws: Mapping[str, Any], *, release_time: float | None, robust: bool
) -> DecayFit | LawComparison[DecayFit]:
    """Fit a decay as ``fit_decay`` does by its laws; where one is ``auto``, return the comparison of all."""
    if "auto" not in laws.values():
        return fit_decay(record, release_time=release_time, robust=robust, **laws)
    if robust:
        raise InputError("compares sums of squares, which outliers decide; choose a law", "auto")
    return compare_decay_laws(record, release_time=release_time, **comparison_arguments(**laws))


@lasting_interrupts()
def fit_decays(
    records: Sequence[Measurement],
    *,
    law: Law = "linear",
    frequency_law: FrequencyLaw = "constant",
    rest: Rest = "constant",
    release_times: Sequence[float] | None = None,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
    robust: bool = False,
) -> DecayFits:
    """Fit several free decays of one mode at once and each alone, and test whether they agree.

    The records share frequency and damping coefficients; each has its own amplitude, phase and rest position.

    Parameters
    ----------
    records : sequence of Measurement
        The records.
    law, frequency_law, rest, ratio_bounds, robust
        As in ``fit_decay``, without ``auto``.
    release_times : sequence of float, optional
        Start of the free decay in each record, s; detected in the records if not given.

    Returns
    -------
    DecayFits
        Result for each record, with the same frequency and damping coefficients; and the agreement of the records.

    Raises
    ------
    InputError
        If a record is not usable, nothing in it oscillates, or an option is unknown.
    FitError
        If the fit does not converge.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import fit_decays
    >>> time, rng = np.linspace(0.0, 10.0, 1001), np.random.default_rng(0)
    >>> y = np.exp(-0.1 * time) * np.cos(12.0 * time)
    >>> takes = [Measurement(time, a * y + rng.normal(scale=1e-4, size=time.size)) for a in (0.02, 0.03)]
    >>> fits = fit_decays(takes)
    >>> [round(fit.amplitude, 3) for fit in fits], round(fits[0].frequency, 2)
    ([0.02, 0.03], 1.91)
    """
    model = DecayModel(law, rest, frequency_law, ratio_bounds)
    robust = flag(robust, "robust")
    records = [clean_record(record) for record in instances(records, "records", Measurement)]
    sensors = {f"{record.sensor.quantity} in {record.sensor.unit}" for record in records}
    places = {record.sensor.label for record in records}  # an amplitude means another motion elsewhere
    if len(sensors) > 1 or (len(places) > 1 and (law, frequency_law) != ("linear", "constant")):
        differing = "; ".join(sorted(sensors if len(sensors) > 1 else places))
        raise InputError(
            f"must be those of one kind of sensor at one place, got {differing}; fit them apart", "records"
        )
    releases = [None] * len(records) if release_times is None else numbers(release_times, "release_times")
    if len(releases) != len(records):
        raise InputError(f"has {len(releases)} values for {len(records)} records", "release_times")
    decays = [cut_at_release(record, release) for record, release in zip(records, releases, strict=True)]
    joint_fits = fit_one_mode(decays, model, robust=robust)
    single_fits = [fit_one_mode([decay], model, robust=robust)[0] for decay in decays] if len(decays) > 1 else []
    for fit in single_fits or joint_fits:
        refuse_unexplained(fit)
    settings: dict[str, Any] = {"law": law, "frequency_law": frequency_law, "rest": rest}
    refit = partial(fit_decays, release_times=release_times, ratio_bounds=ratio_bounds, robust=robust, **settings)
    return DecayFits(joint_fits[0].fit, joint_fits, tuple(single_fits) or joint_fits, again=refit)
