"""Damping laws, and properties of the beam, from the measured large motion of points on it.

The measured positions y_ij of the points s_j at the times t_i of a record are matched by those of the nonlinear beam,

    minimise    1/2 sum (r(s_j, t_i; theta, P, b) - y_ij)^2        within bounds,

over any parameters theta of the damping law, factors common to all elements on the properties P, and the amplitude b of
the base motion.  The motion and its exact derivatives are those of ``motion``; J' J of its forward derivatives serves
as Hessian.  Records, each with its own base motion and start, share all unknowns but the amplitudes.

This takes the place of the closed form (27) where the motion is large: there it lacks the inertia along the beam, the
higher modes, and what the shape of the swing does to the drag.

The scale of each unknown is its guess, so that the solver's tolerance is a relative one.  It stays above the
tolerance of the integration, whose steps change with the unknowns.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 and 4.
"""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ancf_casadi.beam import PROPERTIES
from ancf_casadi.damping import DampingLaw
from ancf_casadi.differentiable import Motion, motion
from ancf_casadi.equilibrium import Equilibrium
from ancf_casadi.exceptions import InputError
from ancf_casadi.excitation import BaseMotion, FixedBase
from ancf_casadi.fit import Fit
from ancf_casadi.inputs import array
from ancf_casadi.model import Model
from ancf_casadi.nlp import Unknown, least_squares
from ancf_casadi.simulate import Start
from ancf_casadi.trajectory import State

Array = NDArray[np.float64]

TOLERANCE = 1e-6  # of the integration
EVEN = 1e-6  # of a sampling interval: how far a sample may be off
NEAR = 0.10  # bounds of a property, on either side
OPTIONS: Mapping[str, Any] = {"ipopt.tol": 1e-5, "ipopt.compl_inf_tol": 1e-7, "ipopt.max_iter": 50}
UNITS = {"alpha": "1/s", "beta": "s", "eta1": "1/s", "eta2": "1/m"}


@dataclass(frozen=True, eq=False)
class MarkerRecord:
    """Measured positions of points on a beam.

    Parameters
    ----------
    time : array_like (k,)
        Instants, s, from 0 at equal intervals.
    positions : array_like (k, m, 2) or (k, 2)
        Positions in the laboratory frame, m, the clamp at rest being the origin; of m points, or of one.
    points : sequence of float
        Their arc lengths from the clamp, m; the tip if not given.
    base : BaseMotion, optional
        Motion of the clamp; fixed if not given.
    start : str, Equilibrium or State
        Start of the motion, as of ``simulate``.

    Raises
    ------
    InputError
        If there are fewer than 10 samples, the times do not begin with 0 or are not evenly spaced, the shapes do not
        fit, or a value is not finite.
    """

    time: ArrayLike
    positions: ArrayLike
    points: Sequence[float] | None = None
    base: BaseMotion | None = None
    start: Start | Equilibrium | State = "equilibrium"

    def __post_init__(self) -> None:
        """Validate, and keep arrays."""
        time, positions = (array(getattr(self, name), name) for name in ("time", "positions"))
        if time.ndim != 1 or time.size < 10:
            raise InputError("needs at least 10 instants", "time")
        step = (time[-1] - time[0]) / (time.size - 1)
        if not step > 0.0 or time[0] != 0.0 or np.abs(time - step * np.arange(time.size)).max() > EVEN * step:
            raise InputError("must begin with 0 and go on at equal intervals; resample the record", "time")
        if positions.ndim == 2:
            positions = positions[:, None, :]
        count = 1 if self.points is None else len(self.points)
        if positions.shape != (time.size, count, 2):
            raise InputError(f"must have the shape {(time.size, count, 2)}, got {positions.shape}", "positions")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "positions", positions)

    @property
    def sample_rate(self) -> float:
        """Samples a second, 1/s."""
        time = np.asarray(self.time)
        return float((time.size - 1) / time[-1])


@dataclass(frozen=True, eq=False)
class TransientFit:
    """What measured motions tell of a damping law and a beam.

    Parameters
    ----------
    law : DampingLaw
        The law with the estimated parameters.
    model : Model
        The beam with the estimated properties.
    fit : Fit
        All unknowns with their uncertainties.
    """

    law: DampingLaw
    model: Model
    fit: Fit

    def report(self) -> str:
        """Return the result as text."""
        return self.fit.report()

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {"law": repr(self.law), **self.fit.to_dict()}


def fit_transient(
    model: Model,
    records: MarkerRecord | Sequence[MarkerRecord],
    damping: DampingLaw,
    *,
    properties: Sequence[str] = (),
    base_amplitude: bool = False,
    fixed: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    robust: float = math.inf,
    tolerance: float = TOLERANCE,
) -> TransientFit:
    """Estimate a damping law, and properties of the beam, from measured motions of the nonlinear beam.

    Parameters
    ----------
    model : Model
        The beam; its properties are guesses where they are unknown.
    records : MarkerRecord or sequence of them
        What was measured.
    damping : DampingLaw
        The law; its parameters (``damping.parameters``) are the guesses.
    properties : sequence of {"width", "thickness", "density", "elastic_modulus"}
        Properties to estimate too, each by a factor common to all elements.
    base_amplitude : bool
        Whether to estimate the amplitude of each record's base motion.
    fixed : sequence of str
        Parameters of the law to keep.
    bounds : mapping, optional
        Bounds by name of the unknown.  If not given: 0 and none for parameters of the law (1 for ratios), 10 % on
        either side of the guess for the others.
    robust : float
        Deviation, m, beyond which the loss grows linearly; least squares without it.
    tolerance : float
        Tolerance of the integration.

    Raises
    ------
    InputError
        If a name is unknown, a point is not on the beam, nothing is to be estimated, or a guess is not within its
        bounds.
    FitError
        If the fit does not converge, or the records do not determine the unknowns.
    """
    records = [records] if isinstance(records, MarkerRecord) else list(records)
    if not records:
        raise InputError("there are none", "records")
    unknowns = _unknowns(damping, records, properties, base_amplitude, fixed, dict(bounds or {}))
    motions = [_motion(model, record, damping, tolerance) for record in records]
    names = [unknown.name for unknown in unknowns]
    points = [_interpolation(model, record) for record in records]

    def residuals(*values: cs.MX) -> cs.MX:
        given = dict(zip(names, values, strict=True))
        theta = [given.get(name, cs.MX(value)) for name, value in _named(damping)]
        own_rows = zip(PROPERTIES, model.properties.tolist(), strict=True)
        rows = [given.get(name, cs.MX(1.0)) * cs.DM(row).T for name, row in own_rows]
        parts = []
        for k, (record, function, matrix) in enumerate(zip(records, motions, points, strict=True)):
            own = _base(record).parameters
            b = [given.get(_amplitude(k, name), cs.MX(value)) for name, value in own]
            coordinates = function(cs.vertcat(cs.MX(0, 1), *theta), cs.vertcat(cs.MX(0, 1), *b), cs.vertcat(*rows))
            measured = np.asarray(record.positions).reshape(len(np.asarray(record.time)), -1).T
            parts.append(cs.vec((cs.DM(matrix) @ coordinates - cs.DM(measured)).T))  # one coordinate after the other
        return cs.vertcat(*parts)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a trial without a motion is stepped back from
        fit = least_squares(residuals, unknowns, huber=robust, gauss_newton=True, options=OPTIONS)
    found = dict(zip(names, fit.values.tolist(), strict=True))
    law = damping.with_parameters([found.get(name, value) for name, value in _named(damping)])
    factors = {name: found.get(name, 1.0) for name in PROPERTIES}
    rows = zip(PROPERTIES, model.properties, strict=True)
    beam = model.beam.with_(**{name: (factors[name] * row).tolist() for name, row in rows})
    return TransientFit(law, Model(beam, model.measures), fit)


def _unknowns(
    damping: DampingLaw,
    records: Sequence[MarkerRecord],
    properties: Sequence[str],
    base_amplitude: bool,
    fixed: Sequence[str],
    bounds: dict[str, tuple[float, float]],
) -> list[Unknown]:
    """Return what is to be estimated, with guesses, scales and bounds."""
    law = _named(damping)
    for name, known, where in [(name, [known for known, _ in law], "fixed") for name in fixed] + [
        (name, list(PROPERTIES), "properties") for name in properties
    ]:
        if name not in known:
            raise InputError(f"{name!r} is none of {', '.join(known)}", where)
    guesses = [(name, value, 0.0, 1.0 - 1e-6 if name.startswith("ratio") else math.inf) for name, value in law]
    guesses = [guess for guess in guesses if guess[0] not in fixed]
    guesses += [(name, 1.0, 1.0 - NEAR, 1.0 + NEAR) for name in properties]
    if base_amplitude:
        numbered = enumerate(records)
        own = [(_amplitude(k, name), value) for k, record in numbered for name, value in _base(record).parameters]
        guesses += [(name, value, (1 - NEAR) * value, (1 + NEAR) * value) for name, value in own]
    if not guesses:
        raise InputError("nothing is to be estimated; a coefficient of 0 is no parameter: guess above 0", "damping")
    unknown = set(bounds) - {guess[0] for guess in guesses}
    if unknown:
        raise InputError(f"{', '.join(sorted(unknown))}: not to be estimated", "bounds")
    result = []
    for name, value, lower, upper in guesses:
        lower, upper = bounds.get(name, (lower, upper))
        unit = "m" if name.startswith("base") else UNITS.get(name.split("_")[0], "")
        result.append(Unknown(name, value, scale=abs(value) or 1.0, lower=lower, upper=upper, unit=unit))
    return result


def _named(damping: DampingLaw) -> list[tuple[str, float]]:
    """Return the parameters of a law; the second of a name in a sum is called ``name_2``."""
    seen: Counter[str] = Counter()
    named = []
    for name, value in damping.parameters:
        seen[name] += 1
        named.append((f"{name}_{seen[name]}" if seen[name] > 1 else name, value))
    return named


def _amplitude(record: int, name: str) -> str:
    """Return the name of a parameter of a record's base motion."""
    return f"base_{name}_{record + 1}"


def _base(record: MarkerRecord) -> BaseMotion:
    return FixedBase() if record.base is None else record.base


def _motion(model: Model, record: MarkerRecord, damping: DampingLaw, tolerance: float) -> Motion:
    """Return the motion a record is held against."""
    return motion(
        model,
        duration=float(np.asarray(record.time)[-1]),
        damping=damping,
        base=record.base,
        sample_rate=record.sample_rate,
        start=record.start,
        tolerance=tolerance,
    )


def _interpolation(model: Model, record: MarkerRecord) -> Array:
    """Return what gives the positions of the points from the nodal coordinates, (2 m, 4 n + 4)."""
    points = (model.beam.length,) if record.points is None else record.points
    return np.vstack([model.interpolation(point) for point in points])
