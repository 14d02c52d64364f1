"""Damping laws, and properties of the beam, estimated from measured steady-state vibration.

The amplitudes Y and phases phi that a sensor measured against frequency, at one or several levels l of the excitation,
are fitted by the steady motion of the beam (``residuals``),

    minimise    1/2 sum (distance of the point (Y, phi, l) to the curve of motions at its frequency)^2   within bounds,

over the parameters of the damping law and the natural frequencies of the modes that the records are about, or the
properties of the beam, its tip mass and its clamp.  The distance counts in standard deviations (``weights``).  It
serves tests with controlled excitation and with controlled response alike, and is defined for all values of the
unknowns, also where a fold of the curve has moved past a measured point (``points``).

The beam is the reduced model in a few modes, each with several harmonics.  A last evaluation with one mode and two
harmonics more shows the effect of this truncation on the estimates; if it is above ``ALLOWED`` standard errors, the fit
is repeated with these.

Records of motions, such as decays, and other evidence enter the same sum of squares, with the same unknowns.  They
share properties, not the factors on natural frequencies of the reduced model.

The levels may have a common error, of an accelerometer or a current probe.  An error of 1 % changes a damping ratio by
about as much at resonance, often far more than the scatter of the points.  The factor on the levels is therefore an
unknown if asked for, with its own standard deviation as evidence; else the result says what an error of 1 % would do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import NoneType
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.least_squares import Unknown, least_squares, restarted
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.mechanics.beam import LUMPED
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import check_instance, choice, choices, instances, positive, whole
from ancf_casadi.vibration.modes import natural_modes
from problems.response.joint import ALLOWED, LEVEL_ERROR, NEGLIGIBLE, OPTIONS, JointProblem, motion_problem
from problems.response.problem import ResponseProblem
from problems.response.record import split_records
from problems.response.residuals import Responses
from problems.response.result import ResponseFit
from problems.response.unknowns import KNOWN, mode_of, response_unknowns
from problems.response.weights import first_weights
from problems.transient.unknowns import Evidence

REPEATED = 2  # repetitions with more modes and harmonics
MODES_ABOVE = 2  # modes of the model above the highest that a record is about
MOST_MODES = 12  # modes among which those of the records are sought
ADVICE = "start from other guesses, set bounds, or fix some unknowns"

Bounds = Mapping[str, tuple[float, float]]


def fit_response(
    model: Model,
    records: Any,
    damping: DampingLaw,
    *,
    properties: Sequence[str] = (),
    excitation: str = "known",
    excitation_deviation: float | None = None,
    fixed: Sequence[str] = (),
    bounds: Bounds | None = None,
    modes: int | None = None,
    harmonics: int = 5,
    evidence: Sequence[Evidence] = (),
) -> ResponseFit:
    """Estimate a damping law, and natural frequencies or properties of the beam, from measured response curves.

    Parameters
    ----------
    model : Model
        The beam; its properties are the guesses of those to be estimated.
    records : ResponseRecord, or sequence of ResponseRecord, MotionRecord, MarkerRecord and Measurement
        Response curves, at least one; and motions such as decays, as in ``fit_transient``.
    damping : DampingLaw
        The law; its parameters (``damping.parameters``) are the guesses.
    properties : sequence of str
        Properties to estimate, each by a factor: ``width``, ``thickness``, ``density``, ``elastic_modulus``,
        ``tip_mass``, ``clamp_stiffness``.  If there are none, the natural frequencies of the modes that the records are
        about are estimated or, together with motions or evidence, the elastic modulus.
    excitation : {"known", "common", "each"}
        Whether to estimate a factor on the levels of the excitation: none, one for all records, or one for each.
    excitation_deviation : float, optional
        Standard deviation of this factor before the fit, such as 0.01; unknown if not given.
    fixed : sequence of str
        Parameters of the law to keep at their guesses.
    bounds : mapping, optional
        Bounds (lower, upper) by name of the unknown.  By default parameters of the law are at least 0 (and ratios at
        most 1), natural frequencies and properties within 10 % of the guess, tip mass and clamp stiffness within a
        factor of 100, and factors on the excitation from 0.5 to 1.5.
    modes, harmonics : int
        Numbers of modes and of harmonics of the first fit; if not given, two modes more than the highest
        that the records are about.
    evidence : sequence of Evidence
        Further measurements of the same beam, such as a ``FrequencyRecord`` with standard deviations.

    Raises
    ------
    InputError
        If there is no response curve, a name is unknown, a point is not on the beam, nothing is to be estimated, a
        guess is not within its bounds, or evidence has no weight.
    FitError
        If the fit does not converge, the records do not determine the unknowns, or the response at a measured point
        cannot be computed, which the message names.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Beam, HarmonicBase, ModalDamping, Model, natural_modes
    >>> from problems import ResponseRecord, fit_response
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model = Model(beam)
    >>> base, frequencies = HarmonicBase(amplitude=1e-3, frequency=1.0), [1.80, 1.84, 1.87, 1.90, 1.93]
    >>> amplitudes = [0.0186, 0.0358, 0.0737, 0.0487, 0.0263]
    >>> record = ResponseRecord(frequencies, amplitudes, base=base, sweep="up")
    >>> fit = fit_response(model, record, ModalDamping(natural_modes(model, count=1), ratios=[0.02]))
    >>> print(f"{fit.estimates['ratio1']:.3f}")
    0.010
    """
    check_instance(model, "model", Model)
    curves, motions = split_records(records)
    check_instance(damping, "damping", DampingLaw)
    properties = choices(properties, KNOWN, "properties")
    check_instance(bounds, "bounds", Mapping, NoneType)
    choice(excitation, ("known", "common", "each"), "excitation")
    if excitation_deviation is not None:
        positive(excitation_deviation, "excitation_deviation")
        if excitation == "known":
            raise InputError("belongs to excitation='common' or 'each'", "excitation_deviation")
    evidence = instances(evidence, "evidence", Evidence, least=0)
    if any(one.deviations is None for one in evidence):
        raise InputError("needs a standard deviation for each value, to be weighed against the curves", "evidence")
    if (motions or evidence) and not properties:
        properties = ("elastic_modulus",)
    if motions and set(properties) & set(LUMPED):
        raise InputError("tip mass and clamp cannot be estimated together with motions", "properties")
    frequencies = natural_modes(model, count=min(MOST_MODES, model.size - model.free.start)).frequencies
    count = max(mode_of(record, frequencies) for record in curves) + 1 + MODES_ABOVE
    unknowns = response_unknowns(
        model, frequencies, curves, motions, damping, properties, excitation, fixed, bounds or {}
    )
    problem = JointProblem(
        names=tuple(unknown.name for unknown in unknowns),
        curves=ResponseProblem(
            model=model,
            records=curves,
            law=damping,
            modes=min(count, len(frequencies)) if modes is None else whole(modes, "modes", 1, len(frequencies)),
            harmonics=whole(harmonics, "harmonics", 1),
            weights=first_weights(curves),
            excitation=excitation,
        ),
        motions=motion_problem(model, motions, damping) if motions else None,
        evidence=evidence,
        excitation_deviation=excitation_deviation,
    )
    return _fit(problem, unknowns)


def _fit(problem: JointProblem, unknowns: Sequence[Unknown]) -> ResponseFit:
    """Return the estimates with enough modes and harmonics."""
    improve = problem.curves.weights.improvable
    responses = Responses(problem.curves, problem.names)
    for repetition in range(REPEATED + 1):
        fit, problem, responses = solved(problem, unknowns, responses, improve=improve)
        curves = np.arange(len(fit.residuals)) < sum(problem.curves.series)
        finer, residuals, by_levels = problem.finer(dict(zip(fit.names, fit.values.tolist(), strict=True)), responses)
        shifts = fit.shifts(np.where(curves, residuals - fit.residuals, 0.0))
        coarse = (np.abs(shifts) > ALLOWED) & (np.abs(shifts) * fit.errors > NEGLIGIBLE * np.abs(fit.values))
        if not coarse.any() or repetition == REPEATED:
            break
        problem, unknowns, improve = finer, restarted(unknowns, fit), False
        responses = responses.continued(problem.curves, problem.names)
    return ResponseFit(problem, fit, shifts, fit.shifts(LEVEL_ERROR * by_levels), responses)


def solved(
    problem: JointProblem, unknowns: Sequence[Unknown], responses: Responses, *, improve: bool = True
) -> tuple[Fit, JointProblem, Responses]:
    """Return the estimates with given modes and harmonics, the problem with the weights that were used, and its curves.

    With ``improve``, a second fit from the estimates of the first uses the standard deviations that its residuals give.
    """
    runs = problem.motions.runs() if problem.motions else []
    motions = [one.function() for one in runs]

    def fitted(problem: JointProblem, unknowns: Sequence[Unknown], responses: Responses) -> Fit:
        def residuals(*values: cs.MX) -> cs.MX:
            return problem.residuals(responses, motions, dict(zip(problem.names, values, strict=True)))

        return least_squares(
            residuals,
            unknowns,
            gauss_newton=True,
            forward=True,
            series=problem.series,
            times=problem.times,
            noise=problem.scale,
            options=OPTIONS,
            advice=ADVICE,
        )

    try:
        fit = fitted(problem, unknowns, responses)
        if improve:
            problem = problem.improved(fit.residuals)
            responses = responses.continued(problem.curves, problem.names)
            fit = fitted(problem, restarted(unknowns, fit), responses)
        return fit, problem, responses
    except FitError as error:
        reasons = [responses.failure, *(str(one.failure) for one in runs if one.failure)]
        raise FitError("; ".join([str(error), *filter(None, reasons)][:2]), error.stats) from None
    finally:
        for one in runs:
            one.forget()
