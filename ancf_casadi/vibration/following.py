"""Modes followed while the properties change, by their shapes and not by their order.

Between two states a mode is the one whose shape stays, by the modal assurance criterion with the masses as weights,

    MAC = (phi^T M phi_0)^2 / (phi_0^T M phi_0),                    phi^T M phi = 1.

The modes phi of a state share the shape phi_0 between them, sum MAC <= 1, so one with more than a half is the only one.
Where no mode has as much, or the equilibrium moves too far, the change is divided and followed in steps.  Modes of
different kinds, bending and axial, cross without knowing of each other; modes that are coupled turn away from the
crossing, and there, in the end, the larger share decides.

References
----------
Allemang 2003, "The modal assurance criterion: twenty years of use and abuse" (MAC).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.vibration.assembly import Structure
from ancf_casadi.vibration.modal_state import modal_state
from ancf_casadi.vibration.modes import Modes
from ancf_casadi.vibration.sensitivities import ModalState

SPARE = 4  # modes above the highest one that are looked at too
CERTAIN = 0.5  # MAC beyond which a mode is the only one
SMALLEST_STEP = 1e-3  # of a change of the properties


def followed_modes(modes: Modes, numbers: Index) -> ModalState:
    """Return the state of some modes, to follow them from.

    Parameters
    ----------
    modes : Modes
        The modes of a beam under gravity alone.
    numbers : array of int (m,)
        Which of them, from 0.
    """
    state = modal_state(Structure.of(modes.model), modes.equilibrium.exact, modes.count)
    if state is None:
        raise EquilibriumError("the equilibrium is unstable, so it has no modes to follow")
    shapes = modes.shapes[:, numbers]
    shares = _shares(state, shapes, state)
    return _selected(state, np.abs(shares).argmax(axis=0), shares)


def follow(start: ModalState, properties: Array) -> ModalState:
    """Return the same modes of the beam with other properties.

    Raises
    ------
    EquilibriumError
        If the beam has no stable equilibrium on the way.
    """
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


def _step(here: ModalState, properties: Array, any_share: bool) -> ModalState | None:
    """Return the modes of a neighbouring state; None where there is none, or a mode is not certain."""
    model = here.model
    count = min(model.size - model.free.start, int(here.numbers.max()) + 1 + SPARE)
    state = modal_state(replace(here.structure, properties=properties), here.at, count)
    if state is None:
        return None
    shares = _shares(here, here.shapes, state)
    modes, targets = linear_sum_assignment(-(shares**2))
    order = modes[np.argsort(targets)]
    if not any_share and (shares[order, np.arange(len(order))] ** 2).min() <= CERTAIN:
        return None
    return _selected(state, order, shares)


def _shares(before: ModalState, shapes: Array, after: ModalState) -> Array:
    """Return phi^T M phi_0 / (phi_0^T M phi_0)^(1/2), (modes after, shapes)."""
    free = before.model.free
    inertia = after.inertia @ shapes[free]
    return np.asarray(after.shapes[free].T @ inertia / np.sqrt(np.sum(shapes[free] * inertia, axis=0)))


def _selected(state: ModalState, order: Index, shares: Array) -> ModalState:
    """Return the state with these modes only, their signs those of the shapes they follow."""
    signs = np.sign(shares[order, np.arange(len(order))])
    return replace(
        state,
        numbers=state.numbers[order],
        eigenvalues=state.eigenvalues[order],
        shapes=state.shapes[:, order] * signs,
    )
