"""A periodic motion as a differentiable CasADi Function of the parameters of its system and of the excitation.

Harmonic balance F(C, p, f, A) = 0 defines the coefficients C near a given motion as functions of the parameters p, the
frequency f and the amplitude A of the excitation.  By the implicit function theorem,

    dC = -(dF/dC)^-1 (dF/dp dp + dF/df df + dF/dA dA),

which is exact for the numbers of harmonics and samples of the given motion.  It fails at a fold, where dF/dC is
singular.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.response.excited import Excited
from ancf_casadi.response.harmonic_balance.balance import fourier, motion_size
from ancf_casadi.response.harmonic_balance.beams import GRAVITY_SIZE
from ancf_casadi.response.harmonic_balance.continuation import point_at
from ancf_casadi.response.harmonic_balance.family import Family, NotFound, Point
from ancf_casadi.response.periodic import PeriodicMotion
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.callbacks import Differentiable, callback_function
from ancf_casadi.support.inputs import check_instance, flag


def motion_function(
    motion: PeriodicMotion,
    point: float | None = None,
    *,
    direction: Sequence[float] | None = None,
    relative: bool = True,
) -> cs.Function:
    """Return the motions near a given one as a differentiable CasADi Function.

    Its inputs are ``damping``, the parameters of the damping law; for the full beam ``properties``, width (m),
    thickness (m), density (kg/m^3) and elastic modulus (Pa) of each element, (4, n); ``frequency``, Hz; and
    ``amplitude``, that of the excitation.  For a SecondOrderSystem, ``parameters`` replace the first two.  Its outputs
    are ``harmonic``, the sine and cosine coefficients of the first harmonic of the displacement of a point, (2,), and
    the ``coefficients`` (2 H + 1, n) of the coordinates.  The numbers of harmonics and samples are those of the given
    motion.  Where Newton's method finds no motion, the outputs are nan.

    Parameters
    ----------
    motion : PeriodicMotion
        The given motion.
    point, direction, relative
        As in ``PeriodicMotion.displacement``.

    Raises
    ------
    InputError
        If the point or coordinate does not exist.

    Examples
    --------
    Derivative of the amplitude by the damping coefficient:

    >>> import casadi as cs
    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping
    >>> from ancf_casadi import motion_function, periodic_motion, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2, damping=RayleighDamping(alpha=0.5))
    >>> tip = motion_function(periodic_motion(reduced, base=HarmonicBase(amplitude=5e-3, frequency=1.9)))
    >>> alpha = cs.MX.sym("alpha")
    >>> amplitude = cs.norm_2(tip(alpha, 1.9, 5e-3)[0])
    >>> derivative = cs.Function("derivative", [alpha], [cs.jacobian(amplitude, alpha)])
    >>> print(f"{float(derivative(0.5)):.3f} m s")
    -0.212 m s
    """
    check_instance(motion, "motion", PeriodicMotion)
    relative = flag(relative, "relative")
    subject, size = motion.excited, motion.coefficients.size
    parameters, varied = _parameters(subject)
    frequency, amplitude = cs.MX.sym("frequency"), cs.MX.sym("amplitude")
    coefficients = callback_function(
        Differentiable(partial(_coefficients_and_derivatives, motion, varied), size, len(varied) + 2), "near"
    )
    values = cs.vertcat(*(cs.vec(symbol) for symbol in reversed(parameters.values())), frequency, amplitude)
    rows, columns = motion.coefficients.shape
    C = cs.reshape(coefficients(values), columns, rows).T
    # samples per harmonic from which a displacement is read
    series = fourier(motion.harmonic_count, 8 * (motion.harmonic_count + 1))
    _, _, shape = subject.drive.samples(series.phases, 0.0, 1.0)
    q, u = (cs.DM(series.basis) @ C).T, amplitude * cs.DM(shape)
    displacement = cs.MX(subject.displacement(q, u, point, direction, relative=relative))
    harmonic = cs.DM(series.analysis[[2, 1]]) @ displacement.T
    inputs = {**parameters, "frequency": frequency, "amplitude": amplitude}
    return cs.Function("motion", [*inputs.values()], [harmonic, C], [*inputs], ["harmonic", "coefficients"])


def _parameters(subject: Excited) -> tuple[dict[str, cs.MX], Index]:
    """Return symbols of the parameters by name, and their indices in the system, the last symbol first."""
    total = len(subject.system.parameters)
    if subject.law is None:
        return {"parameters": cs.MX.sym("parameters", total)}, np.arange(total)
    first = len(subject.law.parameters)
    symbols = {"damping": cs.MX.sym("damping", first)}
    if isinstance(subject.body, Model):
        symbols["properties"] = cs.MX.sym("properties", *subject.body.properties.shape)
    return symbols, np.arange(GRAVITY_SIZE, total)


def _coefficients_and_derivatives(motion: PeriodicMotion, varied: Index, inputs: Array) -> tuple[Array, Array]:
    """Return the coefficients (c,) of the motion near a given one, and their derivatives, (c, m + 2)."""
    point = _continue_motion(motion, varied, inputs)
    balance, by = point.family.balance, point.linear.by
    directions = np.eye(len(balance.system.parameters))[:, varied]
    by_parameters = balance.by_parameters(point.coefficients, point.setting, directions)
    right = np.column_stack([by_parameters, 2 * math.pi * by["omega"], by["amplitude"]])
    derivatives = np.zeros((motion.coefficients.size, right.shape[1]))
    derivatives[balance.allowed.ravel()] = -np.linalg.solve(point.linear.by_coefficients, right)
    return point.coefficients.ravel(), derivatives


def _continue_motion(motion: PeriodicMotion, varied: Index, inputs: Array) -> Point:
    """Return the motion near a given one; if Newton's method fails, change the inputs in several substeps."""
    values, size = motion.balance.system.values, motion_size(motion.balance, motion.coefficients)
    start_inputs = np.append(values[varied], [motion.frequency, motion.drive_amplitude])
    for substeps in (1, 4, 16):
        C = motion.coefficients
        try:
            for fraction in np.arange(1, substeps + 1) / substeps:
                intermediate = start_inputs + fraction * (inputs - start_inputs)
                values[varied], (frequency, amplitude) = intermediate[:-2], intermediate[-2:].tolist()
                balance = replace(motion.balance, system=motion.balance.system.with_values(values))
                setting = replace(motion.setting, omega=2 * math.pi * frequency, amplitude=amplitude)
                scale = max(abs(amplitude), 1e-12)
                family = Family(balance, setting, ("amplitude",), (scale,), size, math.inf)
                point = point_at(family, family.join(C, setting), family.unit("amplitude"))
                C = point.coefficients
        except NotFound:
            continue
        return point
    raise NumericsError("there is no periodic motion near the given one; it may have passed a fold")
