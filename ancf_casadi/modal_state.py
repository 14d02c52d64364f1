"""The equilibrium next to a known one and its lowest modes, for any properties, as fast as an optimiser wants them.

``natural_modes`` derives a model anew for each beam and finds its equilibrium from the straight one.  Here properties
are numbers in Functions derived once, Newton's method starts from a neighbouring equilibrium, and all matrices are
banded: Cholesky's factors K = L L^T, which exist where the equilibrium is stable, serve Lanczos' method on K^-1 M.

Rounding a position by 1e-16 m strains an element of 25 mm by 4e-15, which at the axial stiffness of the paper's beam is
2e-9 N, and moves its frequencies by 5e-10.  What is left of the balance R at the rounded coordinates tells the rest,
de = -K^-1 R, too small to be added to them but not to the stiffness: K + (dK/de) de is that of the equilibrium, and the
noise of the frequencies falls to 3e-12 (20 elements).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from ancf_casadi.eigen_derivatives import BAND, Array, ModalState, sparse
from ancf_casadi.model import NODE, Model
from ancf_casadi.parts import Part, blocks

NEWTON_ITERATIONS = 12
NEWTON_TOLERANCE = 1e-11  # of the beam's length (positions) and of 1/2 (slopes)
LARGEST_TURN = 0.5  # change of a slope from the state nearby


def modal_state(
    model: Model,
    parts: tuple[Part, ...],
    properties: Array,
    near: Array,
    count: int,
) -> ModalState | None:
    """Return the equilibrium next to given coordinates and its lowest modes; None where there is no stable one.

    Parameters
    ----------
    model : Model
        The beam, whose own properties are not used.
    parts : tuple of Part
        What it is made of.
    properties : array (properties,)
        The properties.
    near : array (4 n + 4,)
        Nodal coordinates to start from.
    count : int
        How many modes.
    """
    free = model.free
    coordinates = near.copy()
    scale = model.scale[free]
    slopes = np.arange(model.size).reshape(-1, NODE)[:, 2:]
    for _ in range(NEWTON_ITERATIONS):
        force, stiffness, _ = _assembled(model, parts, properties, coordinates)
        try:
            update = scipy.linalg.solve_banded((BAND, BAND), stiffness, force)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(update).all():
            return None
        coordinates[free] -= update
        if np.abs(coordinates[slopes] - near[slopes]).max() > LARGEST_TURN:
            return None
        if np.abs(update / scale).max() < NEWTON_TOLERANCE:
            break
    else:
        return None
    force, stiffness, mass = _assembled(model, parts, properties, coordinates)
    rest = np.zeros(model.size)
    try:
        rest[free] = -scipy.linalg.solve_banded((BAND, BAND), stiffness, force)
    except np.linalg.LinAlgError:
        return None
    for part in parts:
        arguments = coordinates[part.coordinates], properties[part.properties], rest[part.coordinates]
        change = np.zeros((2 * BAND + 1, model.size))
        _add(change, part, blocks(part.piece.stiffness_change, *arguments)[0])
        stiffness = stiffness + change[:, free]
    found = _lowest(stiffness, mass, count)
    if found is None:
        return None
    shapes = np.zeros((model.size, count))
    shapes[free] = found[1]
    return ModalState(model, parts, properties, coordinates, np.arange(count), found[0], shapes, stiffness, mass)


def _lowest(stiffness: Array, mass: Array, count: int) -> tuple[Array, Array] | None:
    """Return the lowest eigenvalues and their mass-normalised vectors; None where the equilibrium is not stable."""
    size = mass.shape[1]
    try:
        factors = scipy.linalg.cholesky_banded(stiffness[BAND:], lower=True), True
    except np.linalg.LinAlgError:
        return None
    inertia = sparse(mass)
    if 2 * count + 1 >= size:  # more than Lanczos' method is for
        inverse_squares, vectors = scipy.linalg.eigh(inertia.toarray(), sparse(stiffness).toarray())
        eigenvalues = 1 / inverse_squares[: -count - 1 : -1]
        return eigenvalues, vectors[:, : -count - 1 : -1] * np.sqrt(eigenvalues)
    inverse = scipy.sparse.linalg.LinearOperator(
        (size, size), matvec=lambda load: scipy.linalg.cho_solve_banded(factors, load, check_finite=False), dtype=float
    )
    start = np.random.default_rng(0).standard_normal(size) / np.sqrt(stiffness[BAND])
    try:
        eigenvalues, vectors = scipy.sparse.linalg.eigsh(
            sparse(stiffness), count, inertia, sigma=0.0, OPinv=inverse, v0=start
        )
    except scipy.sparse.linalg.ArpackError:
        return None
    order = np.argsort(eigenvalues)
    return eigenvalues[order], vectors[:, order]


def _assembled(model: Model, parts: tuple[Part, ...], properties: Array, e: Array) -> tuple[Array, Array, Array]:
    """Return R, and K and M by diagonals, of the free coordinates."""
    force = np.zeros(model.size)
    stiffness, mass = np.zeros((2 * BAND + 1, model.size)), np.zeros((2 * BAND + 1, model.size))
    for part in parts:
        of_force, of_stiffness, _, of_mass = blocks(
            part.piece.balance, e[part.coordinates], properties[part.properties]
        )
        np.add.at(force, part.coordinates, of_force[:, :, 0])
        _add(stiffness, part, of_stiffness)
        _add(mass, part, of_mass)
    free = model.free
    return force[free], stiffness[:, free], mass[:, free]


def _add(banded: Array, part: Part, matrices: Array) -> None:
    """Add the matrices of pieces to a matrix by diagonals."""
    rows, columns = part.coordinates[:, :, None], part.coordinates[:, None, :]
    np.add.at(banded, (BAND + rows - columns, columns), matrices)
