"""The beam as a script of Exudyn: the same elements, ``ObjectANCFCable2D``, with the same strains.

    elements        those of the beam, with useReducedOrderIntegration=2, whose axial strain is that of this project
    beta            bendingDamping = beta E I, axialDamping = beta E A
    alpha, eta1     a damping matrix per element, multiples of its mass matrix (``ObjectGenericODE2``)
    eta2            a symbolic user function of a ``CartesianSpringDamper`` at two Gauss points per element
    modal           one damping matrix over all nodes, B diag(2 zeta omega) B^T with B = M Phi
    point mass      an ``ObjectGenericODE2`` at its node

The integrator is generalised alpha with a spectral radius of 0.6.  About rest, with v = q_t and accelerations a that
satisfy the equation of motion, it computes an auxiliary acceleration w and (Chung and Hulbert)

    (1 - am) w' + am w = (1 - af) a' + af a,
    q' = q + h v + h^2 ((1/2 - b) w + b w'),    v' = v + h ((1 - g) w + g w').

References
----------
J. Chung, G. M. Hulbert, A time integration algorithm for structural dynamics with improved numerical dissipation: the
generalized-alpha method, Journal of Applied Mechanics 60 (1993).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.linalg

from ancf_casadi.damping import DRAG_CONSTANT, DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping, SumOfLaws
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.dampers import dampers, same_speed
from ancf_casadi.export.simulators.result import ExportedBeam
from ancf_casadi.export.simulators.settings import InProgram, header, listed, prepared, settled
from ancf_casadi.mechanics.attachments import PointMass
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.section import masses_per_length
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import write_file

EXUDYN_MARK = '"""Written by ancf-casadi'
SPECTRAL_RADIUS = 0.6  # with 0.9, waves along the stiff beam let Newton's method fail at long steps


@dataclass(frozen=True)
class SameElements(InProgram):
    """The beam in Exudyn: its own modes, in steps of the integrator."""

    modal: tuple[ModalDamping, ...]

    @property
    def frequencies(self) -> Array:
        """First natural frequencies, Hz."""
        return self.given.modes.frequencies

    @property
    def ratios(self) -> Array:
        """Damping ratios of the law as it is written."""
        law = self.law
        written = RayleighDamping(law.alpha, law.beta), QuadraticDamping(law.eta1, law.eta2), *self.modal
        modes = self.given.modes
        return SumOfLaws(written).damping_ratios(modes, same_speed(modes, self.given.amplitude))

    @property
    def ratio(self) -> float:
        """Damping ratio of mode 1."""
        return float(self.ratios[0])

    def matrix(self, mode: int, step: float) -> Array:
        """Return the matrix of one step of the first modes."""
        omega = 2 * math.pi * self.frequencies
        return np.asarray(
            scipy.linalg.block_diag(*(_generalised_alpha(*pair, step) for pair in zip(omega, self.ratios, strict=True)))
        )


def _generalised_alpha(omega: float, ratio: float, step: float) -> Array:
    """Return the matrix of one step for (q, v, w) of a mode."""
    rho = SPECTRAL_RADIUS
    am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    g = 0.5 + af - am
    b = (g + 0.5) ** 2 / 4
    acceleration = np.array([-(omega**2), -2 * ratio * omega, 0.0])  # of (q, v, w)
    after = np.array([[1, 0, -(step**2) * b], [0, 1, -step * g], [0, 0, 1 - am]]) - (1 - af) * np.outer(
        [0, 0, 1], acceleration
    )
    before = np.array([[1, step, step**2 * (0.5 - b)], [0, 1, step * (1 - g)], [0, 0, -am]]) + af * np.outer(
        [0, 0, 1], acceleration
    )
    return np.asarray(np.linalg.solve(after, before))


def write_exudyn(
    model: Model,
    path: str | Path,
    *,
    damping: DampingLaw | None = None,
    tolerance: float = 0.01,
    amplitude: float | None = None,
) -> ExportedBeam:
    """Write a beam as a script of Exudyn: the same elements in the plane of x and y, released in mode 1.

    The script needs Exudyn alone.  Its function ``run`` returns time and position of the tip.

    Parameters
    ----------
    model, damping, tolerance, amplitude
        See ``write_mujoco``; the elements are those of the beam, and a rigid clamp holds it.
    path : str or Path
        File to write, usually named ``.py``; an earlier one of this function is replaced.

    Raises
    ------
    InputError, EquilibriumError
        See ``write_mujoco``; also if the clamp is elastic or the strain measures are others than the default.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping
    >>> from ancf_casadi.export import write_exudyn
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=8)
    >>> found = write_exudyn(Model(beam), "beam_exudyn.py", damping=RayleighDamping(alpha=0.2, beta=1e-4))
    >>> found.segments, found.step
    (8, 0.0005)
    """
    given, target = prepared(model, path, EXUDYN_MARK, damping, None, tolerance, amplitude)
    beam = model.beam
    if not (isinstance(beam.supports[0], Clamp) and math.isinf(beam.supports[0].stiffness)):
        raise InputError("must be a rigid clamp, to be written for exudyn", "supports")
    if any(not isinstance(one, PointMass) for one in beam.attachments) or model.measures != StrainMeasures():
        raise InputError("has springs, dashpots or strain measures that cannot be written for exudyn", "model")
    terms = damping.laws if isinstance(damping, SumOfLaws) else () if damping is None else (damping,)
    modal = tuple(term for term in terms if isinstance(term, ModalDamping))
    law = dampers(SumOfLaws(tuple(term for term in terms if term not in modal)), given.modes, given.amplitude)
    given = replace(given, segments=beam.elements)
    same, found = settled(given, "exudyn", lambda _: SameElements(given, law, modal))
    write_file(target, _script(same, found))
    return found


EXUDYN_MAPPING = (
    "Elements: ObjectANCFCable2D, those of the beam.  Damping: beta in the elements; alpha, eta1 and modal damping as",
    "matrices; drag (eta2) by user functions.  Not represented: motion out of the plane of x and y, and twist.",
)


def _script(same: SameElements, found: ExportedBeam) -> str:
    """Return the script."""
    model, law = same.given.model, same.law
    beam = model.beam
    straight = np.column_stack([np.outer(beam.node_points, beam.axis), np.tile(beam.axis, (beam.elements + 1, 1))])
    start = NODE * model.root
    modes = same.given.modes
    rest = modes.equilibrium.coordinates[start:].reshape(-1, NODE)
    pull = modes.angular_frequencies[0] ** 2 * found.amplitude  # inertia in mode 1 per mass
    middles = (beam.node_points[:-1] + beam.node_points[1:]) / 2
    density = masses_per_length(beam.density, beam.sections)
    modulus = np.array(beam.elastic_modulus)
    masses = [
        [
            (model.nodes_of(one.point)[0] - start) // NODE,
            one.mass,
            one.rotary_inertia,
            *pull * modes.along([one.point])[0, 0],
        ]
        for one in beam.attachments
        if isinstance(one, PointMass)
    ]
    projections = [np.zeros((model.size, 0)), *(one.projection(model) for one in same.modal)]
    rates = [4 * math.pi * np.array(one.ratios) * np.array(one.frequencies) for one in same.modal]
    numbers = {
        "LENGTHS": beam.element_lengths,
        "DENSITY": density,
        "BENDING": modulus * [s.second_moment for s in beam.sections],
        "AXIAL": modulus * [s.area for s in beam.sections],
        "CURVATURE": np.array(beam.natural_curvature or np.zeros(beam.elements)),
        "STRAIGHT": straight,
        "REST": rest,
        "PULL": pull * modes.along(middles)[0],
        "MODAL": np.hstack(projections)[start:],
        "RATES": np.concatenate([np.zeros(0), *rates]),
    }
    return f'''{EXUDYN_MARK}{header(found, EXUDYN_MAPPING)}
"""

import exudyn as exu
import exudyn.utilities as items
import numpy as np

STEP = {found.step!r}  # s
GRAVITY = np.array([{beam.gravity[0]!r}, {beam.gravity[1]!r}])
ALPHA, BETA, ETA1 = {law.alpha!r}, {law.beta!r}, {law.eta1!r}  # 1/s, s, 1/s
DRAG = {DRAG_CONSTANT * law.eta2!r}  # per mass, 1/m
MASSES = {masses!r}  # node, mass, rotary inertia, pull
# per element: length (m), mass per length, E I, E A, natural curvature, and the pull per mass (m/s^2) that deflects the
# beam in mode 1; per node: x, y and slopes without load and at rest; modal damping MODAL diag(RATES) MODAL^T
{listed(numbers)}
RADIUS = {SPECTRAL_RADIUS!r}  # of generalised alpha


def element_mass(length, density):
    """Return the mass matrix of a cubic element."""
    single = density * length / 420 * np.array([
        [156, 22 * length, 54, -13 * length],
        [22 * length, 4 * length**2, 13 * length, -3 * length**2],
        [54, 13 * length, 156, -22 * length],
        [-13 * length, -3 * length**2, -22 * length, 4 * length**2],
    ])
    return np.kron(single, np.eye(2))


def build(release=1.0):
    """Return a system, at rest under a multiple of the pull that then ends, its tip sensor, and its user functions."""
    mbs = exu.SystemContainer().AddSystem()
    start = REST - STRAIGHT
    nodes = [
        mbs.AddNode(items.NodePoint2DSlope1(referenceCoordinates=reference, initialCoordinates=change))
        for reference, change in zip(STRAIGHT, start)
    ]
    weights, points, kept = [], [], []
    ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.AddObject(items.ObjectGround())))
    for k, length in enumerate(LENGTHS):
        cable = mbs.AddObject(items.ObjectANCFCable2D(
            length=length, massPerLength=DENSITY[k], bendingStiffness=BENDING[k], axialStiffness=AXIAL[k],
            bendingDamping=BETA * BENDING[k], axialDamping=BETA * AXIAL[k], referenceCurvature=CURVATURE[k],
            nodeNumbers=nodes[k : k + 2], useReducedOrderIntegration=2,
        ))
        body = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=cable))
        pull = [*(GRAVITY + release * PULL[k]), 0.0]
        weights.append(mbs.AddLoad(items.LoadMassProportional(markerNumber=body, loadVector=pull)))
        if ALPHA + ETA1:
            matrix = (ALPHA + ETA1) * element_mass(length, DENSITY[k])
            mbs.AddObject(items.ObjectGenericODE2(
                nodeNumbers=nodes[k : k + 2], massMatrix=0.0 * matrix, dampingMatrix=matrix))
        for share in (0.2113248654051871, 0.7886751345948129) if DRAG else ():  # Gauss points
            place = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=cable, localPosition=[share * length, 0.0, 0.0]))
            kept.append(drag(mbs, DRAG * DENSITY[k] * length / 2))
            mbs.AddObject(items.ObjectConnectorCartesianSpringDamper(
                markerNumbers=[ground, place], springForceUserFunction=kept[-1]))
    for node, mass, inertia, x, y in MASSES:
        matrix = np.diag([mass, mass, inertia, inertia])
        pull = [*(mass * (GRAVITY + release * np.array([x, y]))), 0.0, 0.0]
        points.append(mbs.AddObject(items.ObjectGenericODE2(
            nodeNumbers=[nodes[node]], massMatrix=matrix, dampingMatrix=ALPHA * matrix, forceVector=pull)))
    if RATES.size:
        matrix = MODAL * RATES @ MODAL.T
        mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=nodes, massMatrix=0.0 * matrix, dampingMatrix=matrix))
    still = mbs.AddNode(items.NodePointGround())
    fixed = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=still, coordinate=0))
    for k in range(4):
        own = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=k))
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[fixed, own], offset=start[0, k]))
    tip = mbs.AddSensor(items.SensorNode(
        nodeNumber=nodes[-1], storeInternal=True, writeToFile=False,
        outputVariableType=exu.OutputVariableType.Position))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.staticSolver.verboseMode = 0
    settings.solution.file.write = False
    settings.staticSolver.newton.relativeTolerance = 1e-8
    settings.staticSolver.newton.absoluteTolerance = 1e-7
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    mbs.SolveStatic(settings, updateInitialValues=True)
    for load in weights:
        mbs.SetLoadParameter(load, "loadVector", [*GRAVITY, 0.0])
    for point, (_, mass, *_) in zip(points, MASSES):
        mbs.SetObjectParameter(point, "forceVector", [*(mass * GRAVITY), 0.0, 0.0])
    return mbs, tip, kept


def drag(mbs, size):
    """Return a user function with the force of drag at a point."""

    def force(mbs, t, item, displacement, velocity, stiffness, damping, offset):
        rate = size * exu.symbolic.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1])
        return [rate * velocity[0], rate * velocity[1], exu.symbolic.Real(0.0)]

    kind = "ObjectConnectorCartesianSpringDamper"
    return items.CreateSymbolicUserFunction(mbs, force, "springForceUserFunction", itemTypeName=kind)


def run(duration, release=1.0, every=1):
    """Return time, x and y of the tip, s and m, at each ``every``-th step."""
    mbs, tip, kept = build(release)
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps = round(duration / STEP)
    integration.endTime = integration.numberOfSteps * STEP
    integration.generalizedAlpha.spectralRadius = RADIUS
    integration.generalizedAlpha.computeInitialAccelerations = True
    integration.newton.useModifiedNewton = True
    integration.newton.modifiedNewtonJacUpdatePerStep = True
    integration.newton.relativeTolerance = 1e-8
    integration.newton.absoluteTolerance = 1e-8
    integration.verboseMode = 0
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = every * STEP
    mbs.SolveDynamic(settings)
    return mbs.GetSensorStoredData(tip)[:, :3]


if __name__ == "__main__":
    np.savetxt("tip.csv", run(5.0), delimiter=",", header="time_s,tip_x_m,tip_y_m", comments="")
'''
