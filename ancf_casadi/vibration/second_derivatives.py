"""Exact second derivatives of natural frequencies and mode shapes with respect to the properties of the beam.

With the equations and multipliers of ``sensitivities``, the combination y = sum_k (b_k lambda_k + c_k^T phi_k) has the
Lagrangian

    L = y + z^T R + sum_k (a_k^T (K - lambda_k M) phi_k - beta_k/2 (phi_k^T M phi_k - 1)).

Let u = (q, p) and v = (phi, lambda), with the first derivatives u_p and v_p.  The second derivatives are

    y_pp = B + B^T + v_p^T L_vv v_p,    B = u_p^T (1/2 L_uu u_p + L_uv v_p),    u_p^T Y = Y_p - R_p^T K^-1 Y_q,

    v_p^T L_vv v_p = -sum_k (beta_k phi_p^T M phi_p + lambda_p^T (a_k^T M phi_p) + (a_k^T M phi_p)^T lambda_p),

in which Y_q and Y_p are the rows of any matrix Y that belong to q and to p, and phi and lambda those of mode k.  L is a
sum over the elements, so its Hessian is needed for one element and one mode only.  The work grows with the square
of the number of elements if each element has properties of its own.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse

from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.assembly import EqualElements, per_element, scatter
from ancf_casadi.vibration.modal_state import ModalState
from ancf_casadi.vibration.sensitivities import Sensitivities, multipliers, sensitivities

DIRECTIONS_AT_ONCE = 128  # directions at once: few enough that the products of small matrices stay in the cache


def hessian(state: ModalState, directions: Array, b: Array, c: Array) -> Array:
    """Return the second derivatives of one combination of eigenvalues and mode shapes along given directions.

    Parameters
    ----------
    state : ModalState
        Equilibrium and modes.
    directions : array (properties, N)
        Changes of the properties.
    b : array (m,)
        Weight of each eigenvalue.
    c : array (m, 4 n + 4)
        Weights of the coordinates of each mode shape.

    Returns
    -------
    array (N, N)
    """
    free, N = state.model.free, directions.shape[1]
    transposed = scipy.sparse.csr_array(directions).T
    a, beta, z = multipliers(state, b[:, None], c[:, :, None])
    blocks = _lagrangian_hessians(state, a[:, :, 0], beta[:, 0], z[:, 0])
    half, normalisation = np.empty((N, N)), np.zeros((N, N))
    eigenvalues, projections = np.empty((2, len(beta), N))  # lambda_p and a^T M phi_p
    shapes: list[Array] = []
    for begin in range(0, N, DIRECTIONS_AT_ONCE):
        columns = slice(begin, begin + DIRECTIONS_AT_ONCE)
        first = sensitivities(state, directions[:, columns])
        half[:, columns] = np.asarray(transposed @ _b_of_all_properties(state, first, blocks))
        eigenvalues[:, columns] = first.eigenvalues
        for k, shape in enumerate(first.shapes[:, free]):
            projections[k, columns] = (state.inertia @ a[k, free, 0]) @ shape
        if beta.any():
            shapes.append(first.shapes[:, free])
    if shapes:
        for k, shape in enumerate(np.concatenate(shapes, axis=2)):
            normalisation -= beta[k] * shape.T @ (state.inertia @ shape)
    half -= eigenvalues.T @ projections
    return half + half.T + normalisation


def _lagrangian_hessians(state: ModalState, a: Array, beta: Array, z: Array) -> list[tuple[EqualElements, Array]]:
    """Return 1/2 L_uu and L_uv of the elements of each part side by side, (elements, d + k, d + k + m (d + 1))."""
    m, found = len(beta), []
    for part in state.structure.parts:
        elements, shared = len(part.coordinates), sum(part.balance.sizes)
        (of_forces,) = per_element(part.balance.force_hessian, *state.inputs(part), z[part.coordinates])
        inputs = a[:, part.coordinates].reshape(m * elements, -1), np.repeat(beta, elements)[:, None]
        (of_modes,) = per_element(part.balance.pencil_hessian, *state.inputs_of_modes(part), *inputs)
        of_modes = of_modes.reshape(m, elements, *of_modes.shape[1:])[:, :, :shared]
        of_u = (of_forces + of_modes[:, :, :, :shared].sum(axis=0)) / 2
        found.append((part, np.concatenate([of_u, *of_modes[:, :, :, shared:]], axis=2)))
    return found


def _b_of_all_properties(state: ModalState, first: Sensitivities, blocks: list[tuple[EqualElements, Array]]) -> Array:
    """Return B with all properties as its rows and the directions of ``first`` as its columns."""
    free, N = state.model.free, first.directions.shape[1]
    by_coordinate, by_property = np.zeros_like(first.coordinates), np.zeros_like(first.directions)
    for part, block in blocks:
        d = part.balance.sizes[0]
        rows = [first.coordinates[part.coordinates], first.directions[part.properties]]
        for shape, eigenvalue in zip(first.shapes, first.eigenvalues, strict=True):
            rows += [shape[part.coordinates], np.broadcast_to(eigenvalue, (len(block), 1, N))]
        terms = block @ np.concatenate(rows, axis=1)
        by_coordinate += scatter(part.coordinates, terms[:, :d], len(by_coordinate))
        by_property += scatter(part.properties, terms[:, d:], len(by_property))
    z = np.zeros_like(by_coordinate)
    z[free] = -state.stiffness_factors.solve(by_coordinate[free])
    for part, force_jacobian in state.force_jacobians:
        terms = force_jacobian.transpose(0, 2, 1) @ z[part.coordinates]
        by_property += scatter(part.properties, terms, len(by_property))
    return by_property
