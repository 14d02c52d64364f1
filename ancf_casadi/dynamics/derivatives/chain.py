"""Derivatives of a computed motion through its linearised steps: forward along directions, and in reverse.

Forward, along a direction of the data u = (q, v, excitations, parameters) of each step,

    dZ = -G^-1 R_u du,    dV = A^-1 dZ/h,    da = A^-1 (dV - dv)/h,

and the last stage starts the next step.  In reverse, the steps are taken backwards, each transposed: the weights of q,
v and a at the end of a step give the weights w of its increments Z; -R_u^T G^-T w are then weights of u, and give those
of q, v and a at the start.
"""

from __future__ import annotations

import numpy as np

from ancf_casadi.dynamics.derivatives.run import MotionRun, Passage, clamp_jacobians, sample_weights
from ancf_casadi.dynamics.derivatives.tangent import Tangent
from ancf_casadi.dynamics.excitation import EXCITATION
from ancf_casadi.dynamics.radau.stepper import RadauStep
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array, Index, Layout


def forward(tangent: Tangent, run: MotionRun, start: Array, b: Array, parameters: Array) -> Array:
    """Return the derivatives of the samples along d directions, (k, orders, 4 n + 4, d), at fixed instants.

    The directions (..., d) are those of the first q and v, of b, and of the parameters of the equation of motion.
    """
    free, d = len(start) // 2, start.shape[1]
    dq, dv = start[:free], start[free:]
    orders = run.samples.shape[1]
    result = np.zeros((*run.samples.shape, d))
    first = run.passages[0]
    result[run.rest, 0, :NODE] = first.excitation.jacobian(first.excitation.begin)[:NODE] @ b
    result[run.rest, 0, NODE:] = dq
    for passage in run.passages:
        excitation = passage.excitation
        da = passage.acceleration_jacobian @ np.vstack([dq, dv, excitation.jacobian(excitation.begin) @ b, parameters])
        for step, samples, factors in tangent.steps(run, passage):
            given = [excitation.jacobian(step.start + c * step.length) @ b for c in RADAU.nodes.tolist()]
            du = np.vstack([dq, dv, *given, parameters])
            dZ = tangent.increments(step, factors, run.parameters, du).reshape(STAGES, free, d)
            dV = np.einsum("ij,jkl->ikl", RADAU.inverse, dZ) / step.length
            accelerations = np.tensordot(RADAU.inverse[-1], dV - dv, 1) / step.length
            ends = np.array([dq, dv, da, dq + dZ[-1], dV[-1], accelerations])
            if samples.size:
                times = run.times[samples]
                result[samples, :, :NODE] = clamp_jacobians(excitation, times, orders) @ b
                result[samples, :, NODE:] = np.tensordot(sample_weights(step, times, orders), ends, 1)
            dq, dv, da = ends[3:]
    return result


def reverse(tangent: Tangent, run: MotionRun, weights: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives (..., d) of d weighted sums of the samples by the first q and v, b, and the parameters.

    The weights are an array (k, orders, 4 n + 4, d); the instants of the samples are fixed.
    """
    d, given_layout = weights.shape[3], tangent.layout
    free = given_layout["q"].stop
    first_layout = Layout.of(q=free, v=free, excitation=EXCITATION, parameters=run.parameters.size)
    p, b = np.zeros((run.parameters.size, d)), np.zeros((run.passages[0].excitation.parameters.size, d))
    q = v = np.zeros((free, d))
    for passage in reversed(run.passages):
        excitation, a = passage.excitation, np.zeros((free, d))
        for step, samples, factors in tangent.steps(run, passage, backwards=True):
            ends = _sampled(run, passage, step, samples, weights, b)
            q, v, a = ends[3] + q, ends[4] + v, ends[5] + a
            by_velocities = RADAU.inverse[-1] / step.length
            velocities = np.multiply.outer(by_velocities, a)
            velocities[-1] += v
            increments = np.einsum("ji,jkl->ikl", RADAU.inverse, velocities) / step.length
            increments[-1] += q
            found = tangent.given(step, factors, run.parameters, increments.reshape(-1, d))
            by_q, by_v, given, parameters = given_layout.split(found)
            for c, one in zip(RADAU.nodes.tolist(), given.reshape(STAGES, EXCITATION, d), strict=True):
                b += excitation.jacobian(step.start + c * step.length).T @ one
            p += parameters
            q = ends[0] + q + by_q
            v = ends[1] - by_velocities.sum() * a + by_v
            a = ends[2]
        by_q, by_v, given, parameters = first_layout.split(passage.acceleration_jacobian.T @ a)
        q, v = q + by_q, v + by_v
        b += excitation.jacobian(excitation.begin).T @ given
        p += parameters
    first, still = run.passages[0], weights[run.rest, 0].sum(axis=0)
    b += first.excitation.jacobian(first.excitation.begin)[:NODE].T @ still[:NODE]
    return np.vstack([q + still[NODE:], v]), b, p


def _sampled(run: MotionRun, passage: Passage, step: RadauStep, samples: Index, weights: Array, b: Array) -> Array:
    """Return the weights (6, N, d) of q, v and a at both ends of a step from its samples; add those of b to ``b``."""
    if not samples.size:
        return np.zeros((6, weights.shape[2] - NODE, weights.shape[3]))
    times, own, orders = run.times[samples], weights[samples], weights.shape[1]
    b += np.einsum("soim,soid->md", clamp_jacobians(passage.excitation, times, orders), own[:, :, :NODE])
    return np.asarray(np.tensordot(sample_weights(step, times, orders), own[:, :, NODE:], ((0, 1), (0, 1))))
