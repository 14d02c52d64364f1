"""The lowest eigenvalues and eigenvectors of small motion about an equilibrium, to nearly all digits on any mesh.

With the stiffness K and the mass M the modes solve K phi = lambda M phi, lambda = omega^2.  The stiff axial modes put
the largest lambda many orders of magnitude above the smallest, so Lanczos' method works on the inverse,

    (K + a M)^-1 M phi = phi/(lambda + a),

with banded Cholesky factors of K + a M and solutions refined by products K x that keep their digits
(``ancf_casadi.vibration.assembly``).  The shift a bounds the error of an eigenvalue by rounding,

    a = c u sum_i K_ii (over the positions) / mass of the free nodes,    c = 10,    u = 2.2e-16.

It is 1e-6 of the lowest lambda with 20 elements, and as large as the lowest lambda with 4000.  With the shift the
factors exist even if rounding alone would make K indefinite.  Rayleigh's quotient, with the same product, gives lambda
with an error of the order of the squared error of phi.  The equilibrium is stable if and only if no lambda is negative.

The rounding of the strains, u, leaves tensions of u E A, which change a lambda by u E A/(m L) in a beam of mass m.  A
lambda below a hundred times this is zero: the beam is not held against a rigid motion.

References
----------
B. N. Parlett, The Symmetric Eigenvalue Problem, SIAM (1998), Chapters 1 and 13.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import sparse
from ancf_casadi.vibration.assembly import BANDWIDTH, EPSILON, Position, Structure, eigenvalue_shift, solve_refined


def lowest_modes(structure: Structure, at: Position, count: int) -> tuple[Array, Array] | None:
    """Return the lowest modes about an equilibrium of a structure; None if it is not stable.

    They are squared angular frequencies (count,), (rad/s)^2, ascending, 0 for rigid motions, and mass-normalised mode
    shapes (size, count) in all coordinates, zero where supports hold the beam.
    """
    _, stiffness, mass = structure.linearisation(at)
    inertia, product = sparse(mass).tocsr(), structure.stiffness_product(at)
    try:
        vectors = _lowest_eigenvectors(structure.model, stiffness, mass, product, count)
    except np.linalg.LinAlgError:
        return None
    except scipy.sparse.linalg.ArpackError as error:
        raise EquilibriumError(
            f"the modes were not found ({error}); ask for fewer modes or use fewer elements"
        ) from None
    eigenvalues = np.empty(count)
    for k, phi in enumerate(vectors.T):
        phi /= np.sqrt(phi @ (inertia @ phi))
        eigenvalues[k] = phi @ product(phi)
    rounding = eigenvalue_rounding(structure.model)
    if not (eigenvalues > -rounding).all():
        return None
    eigenvalues[np.abs(eigenvalues) <= rounding] = 0.0
    order = np.argsort(eigenvalues)
    return eigenvalues[order], structure.model.with_fixed_base(vectors[:, order])


def moves_freely(structure: Structure, at: Position) -> bool:
    """Return whether neither supports nor springs resist some rigid motion of a beam in equilibrium."""
    modes = None if structure.model.is_held else lowest_modes(structure, at, 1)
    return modes is not None and not modes[0].any()


def is_definite(banded: Array) -> bool:
    """Return whether a symmetric matrix stored by diagonals has only positive pivots, so only positive eigenvalues."""
    try:
        scipy.linalg.cholesky_banded(banded[BANDWIDTH:], lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return False
    return True


def eigenvalue_rounding(model: Model) -> float:
    """Return the size below which a squared angular frequency is zero, (rad/s)^2."""
    width, thickness, _, modulus = model.properties
    return 100 * EPSILON * float((modulus * width * thickness).max()) / (model.beam.mass * model.beam.length)


def _lowest_eigenvectors(
    model: Model, stiffness: Array, mass: Array, product: Callable[[Array], Array], count: int
) -> Array:
    """Return the eigenvectors of the lowest eigenvalues as columns."""
    size, inertia, shift = mass.shape[1], sparse(mass).tocsr(), eigenvalue_shift(model, stiffness, mass)
    shifted = stiffness + shift * mass
    factors = scipy.linalg.cholesky_banded(shifted[BANDWIDTH:], lower=True), True
    if 2 * count + 1 >= size:  # too many for Lanczos' method
        _, vectors = scipy.linalg.eigh(inertia.toarray(), sparse(shifted).toarray())
        return np.asarray(vectors[:, : -count - 1 : -1])  # the largest 1/(lambda + a) are the last

    def solve(load: Array) -> Array:
        return np.asarray(scipy.linalg.cho_solve_banded(factors, load, check_finite=False))

    def product_with_shift(x: Array) -> Array:
        return np.asarray(product(x) + shift * (inertia @ x))

    inverse = scipy.sparse.linalg.LinearOperator(
        (size, size), matvec=lambda load: solve_refined(solve, product_with_shift, load), dtype=float
    )
    start = np.random.default_rng(0).standard_normal(size) / np.sqrt(shifted[BANDWIDTH])
    _, vectors = scipy.sparse.linalg.eigsh(
        sparse(stiffness), count, inertia, sigma=-shift, OPinv=inverse, v0=start
    )  # eigsh uses only the size of its first argument
    return np.asarray(vectors)
