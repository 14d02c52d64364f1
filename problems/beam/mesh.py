"""A beam, its laws and its starts on a mesh of elements half as long, which shows the error of the mesh.

A state between the old nodes is that of least strain energy, so that it bends the new elements without stretching them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse.linalg

from ancf_casadi.damping import DampingLaw, ModalDamping
from ancf_casadi.damping.law import SumOfLaws
from ancf_casadi.exceptions import NumericsError
from ancf_casadi.mechanics.beam import SplitBeam
from ancf_casadi.mechanics.mesh_limits import SHORT_ELEMENTS_ADVICE
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import natural_modes
from ancf_casadi.vibration.statics import static_equilibrium
from problems.beam.motions.record import MotionRecord


def split_model(model: Model) -> Model:
    """Return a model with each element in two halves; refuse elements that would be as short as the beam is thick."""
    fine = Model(SplitBeam.of(model.beam), model.measures)
    if fine.has_short_elements:
        raise NumericsError(f"the mesh cannot be finer: {SHORT_ELEMENTS_ADVICE}")
    return fine


def split_law(law: DampingLaw) -> DampingLaw:
    """Return a law for models with each element in two halves."""
    if isinstance(law, SumOfLaws):
        return replace(law, laws=tuple(map(split_law, law.laws)))
    if not isinstance(law, ModalDamping):
        return law
    loads, model = law.modes.equilibrium.all_loads, split_model(law.modes.model)
    modes = natural_modes(model, count=law.modes.count, equilibrium=static_equilibrium(model, loads=loads))
    return replace(law, modes=modes)


def split_record(record: MotionRecord, coarse: Model, fine: Model) -> MotionRecord:
    """Return a record whose start, if it belongs to a mesh, belongs to that with each element in two halves."""
    start = record.start
    if isinstance(start, Equilibrium):
        start = replace(start, model=fine, coordinates=_split_shape(start.coordinates, coarse, fine)[0], remainder=None)
    elif isinstance(start, State):
        coordinates, chart = _split_shape(start.coordinates, coarse, fine)
        start = replace(start, coordinates=coordinates, velocities=chart @ start.velocities)
    return replace(record, start=start, model=None)


def _split_shape(coordinates: Array, coarse: Model, fine: Model) -> tuple[Array, Array]:
    """Return coordinates of least strain energy between given nodes, and their Jacobian by those of these nodes."""
    rows = np.eye(coarse.size)
    nodes = [*np.split(rows, coarse.size // NODE)[: coarse.root]]
    nodes += [np.vstack([coarse.interpolation(s), coarse.slope_interpolation(s)]) for s in fine.beam.node_points]
    chart = np.vstack(nodes)
    is_new = np.ones(len(nodes), dtype=bool)
    is_new[: coarse.root] = is_new[coarse.root :: SplitBeam.parts] = False
    places = np.flatnonzero(np.repeat(is_new, NODE))
    e = chart @ coordinates
    for _ in range(12):
        stiffness = fine.tangent_stiffness(e, fine.properties).sparse().tocsc()
        factors = scipy.sparse.linalg.splu(stiffness[places][:, places])
        step = factors.solve(fine.elastic_force(e, fine.properties).full().ravel()[places])
        e[places] -= step
        if np.abs(step / fine.scale[places]).max() < 1e-11:
            break
    old = np.setdiff1d(np.arange(fine.size), places)
    chart[places] = -factors.solve((stiffness[places][:, old]).toarray()) @ chart[old]
    return e, chart
