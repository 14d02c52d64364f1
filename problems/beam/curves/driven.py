"""The reduced beam under a harmonic excitation, and a sensor on it, as a system of second order.

The equation of motion of the modal coordinates q (``ancf_casadi.reduction``) is

    0 = R = M(q) a + h(q, v, u, p) + diag((c_k^2 - 1) w_k^2) q + (E - 1) dU/dq - Q_tip(q, l sin tau),

with the phase tau = omega t and the size l of the excitation: the amplitude of the base motion u = l d sin tau along d,
m, or the multiple of a tip load.  The unknowns s are the parameters p of the damping law, the factors c on the natural
frequencies, and the factor E on the elastic modulus, to which the strain energy U is proportional.  The linear
stiffness that is added to mode k makes its angular frequency at rest c_k w_k exactly.  A model whose frequencies differ
from the measured ones by more than a fraction of the damping ratio has another response altogether, so that the factors
belong to every fit of a damping law.

The sensor reads an expression of the nodal coordinates that belong to q (``derivatives.reading``).  The reading h at
the N samples tau_j of a motion has the fundamental

    Y exp(i phi) = sum_j 2/N (sin tau_j + i cos tau_j) h_j.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.derivatives.reading import SampledMotion
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.placed_load import TIP
from ancf_casadi.reduction.forces import BASE_SIZE, Expression
from ancf_casadi.reduction.reduced import Reduction, reduced_motion
from ancf_casadi.response.harmonic_balance.balance import Fourier, HarmonicBalance, Setting, fourier
from ancf_casadi.response.harmonic_balance.beams import reduced_forces, reduced_system
from ancf_casadi.response.harmonic_balance.family import Family
from ancf_casadi.response.harmonic_balance.system import BEAM_EXCITATION, Drive, SecondOrderSystem, beam_drive
from ancf_casadi.response.onset import linear_response
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.compilation import evaluate_dense
from problems.beam.curves.record import ResponseRecord


@dataclass(frozen=True, eq=False)
class Driven:
    """A reduced beam under the excitation of a record, with its sensor."""

    system: SecondOrderSystem  # its parameters are the unknowns s
    drive: Drive  # at level 1
    fourier: Fourier
    # (C and amplitude of the excitation (d + 1,), omega, s) -> Y and phi (2,), and their Jacobians by the first
    # and the last input; d = (2 H + 1) n
    reading: cs.Function

    def curve(self, omega: float, s: Array) -> Family:
        """Return the curve of motions at a frequency for values of the unknowns; its free entry is the amplitude."""
        balance = HarmonicBalance(self.system.with_values(s), self.drive, self.fourier)
        size = self.drive.amplitude
        return Family(balance, Setting(omega, size), ("amplitude",), (size,), 1.0, math.inf)

    def read(self, curve: Family, z: Array) -> tuple[Array, Array, Array]:
        """Return Y and phi of the motion with the unknowns z of a curve, and their derivatives by z and by s."""
        polar, by_z, by_s = evaluate_dense(self.reading, z, curve.setting.omega, curve.balance.system.values)
        return polar.ravel(), by_z, by_s


def driven_beam(reduced: Reduction, record: ResponseRecord, harmonics: int) -> Driven:
    """Return a reduced beam under the excitation of a record, with its sensor, for a number of harmonics."""
    drive = beam_drive(record.base, record.load)
    # enough samples for the products of a few harmonics, and for the kink of |v| v
    series = fourier(harmonics, max(32, 6 * harmonics + 2))
    return Driven(reduced_system(reduced, tuned=True), drive, series, _reading(reduced, record, drive, series))


def small_response(driven: Driven, record: ResponseRecord, frequency: float, s: Array) -> ResponseRecord:
    """Return the response to a small level about a natural frequency (Hz), at the spacing of the points of a record."""
    peak = record.f[int(np.argmax(record.amplitudes / record.a))]
    values, amplitudes = record.f / peak * frequency, []
    for f in values.tolist():
        curve, slight = driven.curve(2 * math.pi * f, s), 1e-9 * driven.drive.amplitude
        response = linear_response(curve.balance, 2 * math.pi * f)
        z = curve.join(response[0] + slight * response[1], replace(curve.setting, amplitude=slight))
        amplitude, phase = driven.read(curve, z)[0]
        amplitudes.append(amplitude / 1e-9 * np.exp(1j * phase))
    return ResponseRecord(values, np.array(amplitudes), sensor=record.sensor, base=record.base, load=record.load)


def fourier_coefficients(
    reduced: Reduction, record: ResponseRecord, series: Fourier, motions: Sequence[Array], s: Array
) -> tuple[Array, ComplexArray]:
    """Return F (m, 2 H + 1, n) and Y exp(i phi) (m,) of a reduced beam for samples of q, v, a and u of m motions."""
    q, v, a, u, p = (cs.DM(array) for array in (*motions, s))
    balance = reduced_forces(reduced, TIP, True, q, v, a, u, p)[0]
    h = _readings(reduced, record, q, v, a, u, p[: len(reduced.law.parameters)])
    R, read = (
        cs.evalf(cs.MX(expression)).full().reshape(expression.size1(), -1, series.samples)
        for expression in (balance, h)
    )
    sine, cosine = np.einsum("as,ms->am", series.analysis[[2, 1]], read[0])
    return np.einsum("as,nms->man", series.analysis, R), sine + 1j * cosine


def shapes(reduced: Reduction, motions: Sequence[Sequence[Array]]) -> Array:
    """Return the nodal coordinates (k, size) for samples of q, v, a and u of several motions."""
    q, v, _, u = (cs.DM(np.hstack(samples)) for samples in zip(*motions, strict=True))
    motion = reduced_motion(reduced.projection, q, v, u[:BASE_SIZE, :], cs.DM(reduced.model.beam.gravity))
    coordinates: Array = cs.evalf(cs.MX(motion.nodal(*motion.parts, u[:2, :]))).full().T
    return coordinates


def _reading(reduced: Reduction, record: ResponseRecord, drive: Drive, series: Fourier) -> cs.Function:
    """Return the fundamental of the reading with its Jacobians, as in ``Driven``."""
    n, laws = reduced.count, len(reduced.law.parameters)
    z, omega, s = cs.MX.sym("z", n * series.size + 1), cs.MX.sym("omega"), cs.MX.sym("s", laws + n + 1)
    C = cs.reshape(z[:-1], n, series.size)
    q, v, a = (cs.mtimes(C, cs.DM(basis.T)) for basis in (series.basis, series.slope, series.curvature))
    u = drive.expression(series.phases, omega, z[-1])
    law = cs.repmat(s[:laws], 1, series.samples)
    h = _sensor(reduced, record).map(series.samples)(q, omega * v, omega**2 * a, u, law)
    sine, cosine = cs.vertsplit(cs.mtimes(cs.DM(series.analysis[[2, 1]]), h.T))
    polar = cs.vertcat(cs.hypot(sine, cosine), cs.atan2(cosine, sine))
    jacobians = [cs.densify(cs.jacobian(polar, by)) for by in (z, s)]
    return cs.Function("reading", [z, omega, s], [polar, *jacobians], ["z", "omega", "s"], ["polar", "by_z", "by_s"])


def _sensor(reduced: Reduction, record: ResponseRecord) -> cs.Function:
    """Return the reading of the sensor as a Function (q, v, a, u, parameters of the law)."""
    sizes = dict.fromkeys("qva", reduced.count) | {"u": BEAM_EXCITATION, "law": len(reduced.law.parameters)}
    symbols = [cs.MX.sym(name, size) for name, size in sizes.items()]
    return cs.Function("sensor", symbols, [_readings(reduced, record, *symbols)]).expand()


def _readings(
    reduced: Reduction, record: ResponseRecord, q: Expression, v: Expression, a: Expression, u: Expression,
    law: Expression,
) -> Expression:  # fmt: skip
    """Return the readings of the sensor, (1, N), for samples that are numbers or symbols."""
    equations, gravity = Equations(reduced.model, reduced.law), cs.DM(reduced.model.beam.gravity)
    motion = reduced_motion(reduced.projection, q, v, u[:BASE_SIZE, :], gravity)
    by_order = motion.parts, motion.part_rates, motion.part_accelerations(a)
    e, e_t, e_tt = (motion.nodal(*of_order, u[3 * k : 3 * k + 2, :]) for k, of_order in enumerate(by_order))
    return SampledMotion.of(equations, e, e_t, e_tt, u[BASE_SIZE:, :], equations.parameters_with(law=law)).read(
        record.sensor
    )
