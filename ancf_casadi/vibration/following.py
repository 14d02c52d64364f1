"""Following modes by their shapes, not by their order, while the properties change.

Over a small change of the properties a mode keeps its shape.  Shapes are compared by the modal assurance criterion,
weighted with the mass matrix,

    MAC = (phi^T M phi_0)^2 / (phi_0^T M phi_0),                    phi^T M phi = 1.

For one shape phi_0 the values of all modes phi add up to at most 1, so at most one mode exceeds one half.  If no mode
does, or the equilibrium moves too far, the change is divided into smaller steps.  Uncoupled modes, such as bending and
axial modes, cross without changing shape.  Coupled modes veer away from the crossing; there, in the smallest step, the
assignment with the largest sum of MAC values decides.

References
----------
Allemang 2003, "The modal assurance criterion: twenty years of use and abuse" (MAC).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.vibration.modal_state import ModalState, modes_near
from ancf_casadi.vibration.modes import Modes

SMALLEST_STEP = 1e-3  # relative to the whole change of the properties


def followed_modes(modes: Modes, numbers: Index) -> ModalState:
    """Return the modes with the given numbers, from 0, of a beam under gravity alone, as a state to follow."""
    rest, eigenvalues = modes.equilibrium, modes.angular_frequencies[numbers] ** 2
    return ModalState(rest.structure, rest.exact, numbers, eigenvalues, modes.shapes[:, numbers])


def follow(start: ModalState, properties: Array) -> ModalState:
    """Return the same modes of the beam with other properties; fail if there is no stable equilibrium on the way."""
    here, position, step = start, 0.0, 1.0
    while position < 1.0:
        there = min(1.0, position + step)
        trial = _step(here, start.properties + there * (properties - start.properties), step <= SMALLEST_STEP)
        if trial is None:
            step /= 2
            if step < SMALLEST_STEP / 2:
                raise EquilibriumError(
                    f"the beam has no stable equilibrium beyond {position:.3g} of the change of its properties"
                )
            continue
        here, position = trial, there
        step *= 2
    return here


def _step(here: ModalState, properties: Array, smallest: bool) -> ModalState | None:
    """Return the modes of a neighbouring state; None if there is none, or the step is ambiguous and not smallest."""
    model = here.model
    # additional modes computed above the highest one followed
    count = min(model.size - model.free.start, int(here.numbers.max()) + 1 + 4)
    state = modes_near(replace(here.structure, properties=properties), here.at, count)
    if state is None:
        return None
    correlations = _correlations(here, state)
    modes, targets = scipy.optimize.linear_sum_assignment(-(correlations**2))
    order = modes[np.argsort(targets)]
    # MAC above which the assignment is unique
    if not smallest and (correlations[order, np.arange(len(order))] ** 2).min() <= 0.5:
        return None
    signs = np.sign(correlations[order, np.arange(len(order))])  # each mode continues with its sign
    numbers, eigenvalues, shapes = state.numbers[order], state.eigenvalues[order], state.shapes[:, order] * signs
    return replace(state, numbers=numbers, eigenvalues=eigenvalues, shapes=shapes)


def _correlations(before: ModalState, after: ModalState) -> Array:
    """Return phi^T M phi_0 / (phi_0^T M phi_0)^(1/2), the signed root of the MAC, (modes after, modes before)."""
    free = before.model.free
    shapes = before.shapes[free]
    inertia = after.inertia @ shapes
    return np.asarray(after.shapes[free].T @ inertia / np.sqrt(np.sum(shapes * inertia, axis=0)))
