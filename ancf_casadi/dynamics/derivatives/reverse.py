"""Reverse sensitivities: the derivatives of weighted sums of a computed motion with respect to all its parameters.

The steps of ``forward`` are taken backwards, each transposed.  The weights of q, v and a at the end of a step give the
weights w of its increments Z; -R_u^T G^-T w are then weights of u, and give those of q, v and a at the start.
"""

from __future__ import annotations

import numpy as np

from ancf_casadi.dynamics.derivatives.linearised import LinearisedStep, LinearisedSteps
from ancf_casadi.dynamics.derivatives.run import MotionRun, Passage
from ancf_casadi.dynamics.derivatives.sampling import clamp_jacobians, sample_weights
from ancf_casadi.dynamics.equations import EXCITATION
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array, Layout


def reverse(linearisation: LinearisedSteps, run: MotionRun, weights: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives of d sums of the samples with respect to the first q and v, b, and the parameters.

    Each is an array (..., d).  The instants of the samples are fixed.

    Parameters
    ----------
    linearisation : LinearisedSteps
        The Functions of linearised steps.
    run : MotionRun
        The motion.
    weights : array (k, orders, 4 n + 4, d)
        Weights of the samples in the sums.
    """
    d, given_layout = weights.shape[3], linearisation.tangent.layout
    free = given_layout["q"].stop
    first_layout = Layout.of(q=free, v=free, excitation=EXCITATION, parameters=run.parameters.size)
    p, b = np.zeros((run.parameters.size, d)), np.zeros((run.passages[0].excitation.b.size, d))
    q = v = np.zeros((free, d))
    for passage in reversed(run.passages):
        excitation, a = passage.excitation, np.zeros((free, d))
        for linear in linearisation.steps(run, passage, backwards=True):
            step = linear.step
            ends = _sampled(run, passage, linear, weights, b)
            q, v, a = ends[3] + q, ends[4] + v, ends[5] + a
            by_velocities = RADAU.inverse[-1] / step.length
            velocities = np.multiply.outer(by_velocities, a)
            velocities[-1] += v
            increments = np.einsum("ji,jkl->ikl", RADAU.inverse, velocities) / step.length
            increments[-1] += q
            by_q, by_v, given, parameters = given_layout.split(linear.given(increments.reshape(-1, d)))
            for c, one in zip(RADAU.nodes.tolist(), given.reshape(STAGES, EXCITATION, d), strict=True):
                b += excitation.jacobian(step.start + c * step.length).T @ one
            p += parameters
            q = ends[0] + q + by_q
            v = ends[1] - by_velocities.sum() * a + by_v
            a = ends[2]
        by_q, by_v, given, parameters = first_layout.split(passage.acceleration_jacobian.T @ a)
        q, v = q + by_q, v + by_v
        b += excitation.jacobian(passage.begin).T @ given
        p += parameters
    first, still = run.passages[0], weights[run.rest, 0].sum(axis=0)
    b += first.excitation.jacobian(first.begin)[:NODE].T @ still[:NODE]
    return np.vstack([q + still[NODE:], v]), b, p


def _sampled(run: MotionRun, passage: Passage, linear: LinearisedStep, weights: Array, b: Array) -> Array:
    """Return the weights (6, N, d) of q, v and a at both ends of a step from its samples; add those of b to ``b``."""
    samples = linear.samples
    if not samples.size:
        return np.zeros((6, weights.shape[2] - NODE, weights.shape[3]))
    times, own, orders = run.times[samples], weights[samples], weights.shape[1]
    b += np.einsum("soim,soid->md", clamp_jacobians(passage.excitation, times, orders), own[:, :, :NODE])
    return np.asarray(np.tensordot(sample_weights(linear.step, times, orders), own[:, :, NODE:], ((0, 1), (0, 1))))
