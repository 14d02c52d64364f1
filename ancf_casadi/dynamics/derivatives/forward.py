"""Forward sensitivities: the derivatives of a computed motion along some directions of its parameters.

For each step, with its data u = (q, v, excitations, parameters),

    dZ = -G^-1 R_u du,    dV = A^-1 dZ/h,    da = A^-1 (dV - dv)/h,

and the last stage starts the next step.
"""

from __future__ import annotations

import numpy as np

from ancf_casadi.dynamics.derivatives.linearised import LinearisedSteps
from ancf_casadi.dynamics.derivatives.run import MotionRun
from ancf_casadi.dynamics.derivatives.sampling import clamp_jacobians, sample_weights
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array


def forward(linearisation: LinearisedSteps, run: MotionRun, start: Array, b: Array, parameters: Array) -> Array:
    """Return the derivatives of the samples along d directions, (k, orders, 4 n + 4, d), at fixed instants.

    Parameters
    ----------
    linearisation : LinearisedSteps
        The Functions of linearised steps.
    run : MotionRun
        The motion.
    start, b, parameters : array (..., d)
        Directions of the first q and v, the parameters of the base motion and those of the equation of motion.
    """
    free, d = len(start) // 2, start.shape[1]
    dq, dv = start[:free], start[free:]
    orders = run.samples.shape[1]
    result = np.zeros((*run.samples.shape, d))
    first = run.passages[0]
    result[run.rest, 0, :NODE] = first.excitation.jacobian(first.begin)[:NODE] @ b
    result[run.rest, 0, NODE:] = dq
    for passage in run.passages:
        excitation = passage.excitation
        da = passage.acceleration_jacobian @ np.vstack([dq, dv, excitation.jacobian(passage.begin) @ b, parameters])
        for linear in linearisation.steps(run, passage):
            step = linear.step
            given = [excitation.jacobian(step.start + c * step.length) @ b for c in RADAU.nodes.tolist()]
            dZ = linear.increments(np.vstack([dq, dv, *given, parameters])).reshape(STAGES, free, d)
            dV = np.einsum("ij,jkl->ikl", RADAU.inverse, dZ) / step.length
            accelerations = np.tensordot(RADAU.inverse[-1], dV - dv, 1) / step.length
            ends = np.array([dq, dv, da, dq + dZ[-1], dV[-1], accelerations])
            if linear.samples.size:
                times = run.times[linear.samples]
                result[linear.samples, :, :NODE] = clamp_jacobians(excitation, times, orders) @ b
                result[linear.samples, :, NODE:] = np.tensordot(sample_weights(step, times, orders), ends, 1)
            dq, dv, da = ends[3:]
    return result
