"""The equilibrium next to a known one and its lowest modes, for any properties, as fast as an optimiser needs them.

``natural_modes`` finds the equilibrium from the straight beam.  Here Newton's method starts from a neighbouring
equilibrium, and the properties are numbers in Functions derived once.  Newton's method and the eigenvalue solver are
the same (``ancf_casadi.vibration.equilibrium``, ``ancf_casadi.vibration.eigensolver``).
"""

from __future__ import annotations

import numpy as np

from ancf_casadi.vibration.assembly import Position, Structure
from ancf_casadi.vibration.eigensolver import lowest_modes
from ancf_casadi.vibration.equilibrium import neighbour
from ancf_casadi.vibration.sensitivities import ModalState


def modal_state(structure: Structure, near: Position, count: int) -> ModalState | None:
    """Return the equilibrium next to a position and its lowest modes; None where there is no stable one.

    Parameters
    ----------
    structure : Structure
        The beam.
    near : Position
        Where to start.
    count : int
        Number of modes.
    """
    at = neighbour(structure, near)
    found = None if at is None else lowest_modes(structure, at, count)
    if at is None or found is None:
        return None
    shapes = np.zeros((structure.model.size, count))
    shapes[structure.model.free] = found[1]
    return ModalState(structure, at, np.arange(count), found[0], shapes)
