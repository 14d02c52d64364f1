"""Cases of ``compare_exudyn.py``, and their solution in Exudyn.

The beam of the paper hangs from a clamp that oscillates and is then held.

    large    25 s of mode 1, up to 0.25 m at the tip, three laws; the beam starts with the velocity of the clamp.
    blow     3 s of mode 5, undamped; the beam starts at rest while the clamp has a velocity, which is an impact.

Exudyn's model has the same elements and strain measures: ``ObjectANCFCable2D`` with ``useReducedOrderIntegration=2``
(the other quadratures lock).  Coordinate constraints drive and hold the clamped node.  The damping laws are

    mass        one ``ObjectGenericODE2`` per element, with the damping matrix alpha M_e
    modal       one ``ObjectGenericODE2`` over all nodes, with C = M Phi diag(2 zeta omega) Phi^T M
    drag        a ``CartesianSpringDamper`` with a symbolic user function at each of 40 Gauss points

The settings are the best found for Exudyn: exudynFast; generalized alpha with spectral radius 0.9 (its non-dissipative
integrators are unstable here); EigenSparse with a reused pattern, one Jacobian per step; Newton tolerances of 1e-6
(relative) and 1e-8 (absolute); one thread.
"""

from __future__ import annotations

import contextlib
import io
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ancf_casadi import (
    HarmonicBase,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    natural_modes,
    static_equilibrium,
)
from ancf_casadi.damping import DRAG_CONSTANT, DampingLaw
from ancf_casadi.dynamics.simulation import Method
from ancf_casadi.dynamics.start import Start
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.strain import gauss
from benchmarks.beams import DAMPING_RATIOS, steel
from benchmarks.clock import processor_time

Array = NDArray[np.float64]

BEAM = steel()
SAMPLE_RATE = 1000.0  # 1/s, in both programs
LAWS = ("mass", "modal", "drag")


@dataclass(frozen=True)
class Bar:
    """Limit of an error of a solution, ``"error"`` or ``"amplitude"``."""

    kind: str
    limit: float


@dataclass(frozen=True)
class Case:
    """Motion, error limits, and ladders of accuracies.

    Parameters
    ----------
    name, law, title : str
        Name of the case, its damping law, and a description.
    base : HarmonicBase
        Motion of the clamp, along x.
    duration, window : float
        Simulated time, and the compared part at its end, s.
    start : {"equilibrium", "impact"}
        Relative or absolute rest.
    mode : int or None
        Mode number, from 0, whose modal coordinate is compared; None for the tip.
    bars : tuple of Bar
        Error limits.
    tolerances : mapping
        Our tolerances for each integrator, coarse to fine.
    converged : float
        Tolerance of our converged solution, by ``radau``.
    steps : tuple of float
        Exudyn's step sizes (s), coarse to fine; the last two give the extrapolated solution.
    """

    name: str
    law: str
    title: str
    base: HarmonicBase
    duration: float
    window: float
    start: Start
    mode: int | None
    bars: tuple[Bar, ...]
    tolerances: Mapping[Method, tuple[float, ...]]
    converged: float
    steps: tuple[float, ...]


def large(law: str, quick: bool, shorten: float) -> Case:
    """Return case (a) with one of the laws, its times divided by ``shorten``."""
    return Case(
        name="a",
        law=law,
        title="25 s of mode 1 with large rotations, tip over the last second",
        base=HarmonicBase(amplitude=5e-3, frequency=1.85, stop=15.0 / shorten),
        duration=25.0 / shorten,
        window=1.0 / shorten,
        start="equilibrium",
        mode=None,
        bars=(Bar("error", 1e-3),),
        tolerances={
            "idas": (1e-8, 2e-9) if quick else (1e-8, 5e-9, 3e-9, 2e-9, 1e-9),
            "radau": (1e-4, 3e-5, 1e-5, 2e-6),
        },
        converged=1e-8 if quick else 1e-9,
        steps=(1e-3, 0.5e-3) if quick else (1e-3, 0.5e-3, 0.25e-3),
    )


def blow(quick: bool, shorten: float) -> Case:
    """Return case (b), its times divided by ``shorten``."""
    return Case(
        name="b",
        law="undamped",
        title="3 s of mode 5 after an impact on the clamp, modal coordinate over the last second",
        base=HarmonicBase(amplitude=0.1e-3, frequency=94.3388, stop=2.0 / shorten),
        duration=3.0 / shorten,
        window=1.0 / shorten,
        start="impact",
        mode=4,
        bars=(Bar("amplitude", 1e-2), Bar("error", 1e-3)),
        tolerances={
            "idas": (2e-7, 1e-7, 3e-8) if quick else (2e-7, 1e-7, 3e-8, 1e-8, 3e-9),
            "radau": (1e-4, 5e-5, 3e-5, 2e-5, 2e-6, 1e-6, 5e-7, 2e-7),
        },
        converged=1e-8 if quick else 1e-9,
        steps=(0.2e-3, 0.1e-3, 50e-6, 20e-6) if quick else (0.2e-3, 0.1e-3, 50e-6, 20e-6, 10e-6, 5e-6),
    )


def damping(law: str, model: Model) -> DampingLaw | None:
    """Return the damping law for ``simulate``."""
    match law:
        case "mass":
            return RayleighDamping(alpha=0.2325)
        case "modal":
            return ModalDamping(natural_modes(model, count=len(DAMPING_RATIOS)), DAMPING_RATIOS)
        case "drag":
            return QuadraticDamping(eta1=0.15, eta2=0.11)
    return None


@dataclass(frozen=True)
class Solution:
    """Sampled motion and its cost.

    Parameters
    ----------
    coordinates : array (k, 4 n + 4) or (k, 2)
        Nodal coordinates if a mode is compared, otherwise the tip position.
    steps : int
        Number of steps.
    seconds : float
        Processor time, s, including the construction of the model.
    """

    coordinates: Array
    steps: int
    seconds: float


def solve_exudyn(case: Case, step: float) -> Solution:
    """Run a case in Exudyn, which receives equilibrium, mass matrices and modes at no cost."""
    model = Model(BEAM)
    given = _Given(model, static_equilibrium(model).coordinates, damping(case.law, model))
    exu, items = exudyn()
    began = processor_time()
    system = _System(exu, items, case, given)
    if not system.mbs.SolveDynamic(_settings(exu, case.duration, step)):
        raise RuntimeError(f"Exudyn failed with the step {step:g} s")
    seconds = processor_time() - began
    return Solution(system.coordinates(), round(case.duration / step), seconds)


def exudyn() -> tuple[Any, Any]:
    """Return the fast version of Exudyn, and its items.

    Raises
    ------
    ImportError
        If Exudyn is not installed.
    """
    sys.exudynFast = True  # type: ignore[attr-defined]
    with contextlib.redirect_stdout(io.StringIO()):
        import exudyn
        import exudyn.utilities

    return exudyn, exudyn.utilities


@dataclass(frozen=True)
class _Given:
    """Input of Exudyn: the model for its matrices, the equilibrium and the law."""

    model: Model
    rest: Array
    law: DampingLaw | None


class _System:
    """Exudyn system of a case; it keeps the symbolic user functions alive."""

    def __init__(self, exu: Any, items: Any, case: Case, given: _Given) -> None:
        self.exu, self.items, self.case, self.given = exu, items, case, given
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.ground = self.mbs.AddObject(items.ObjectGround())
        self.functions: list[Any] = []
        self.nodes = self._nodes()
        self.cables = self._cables()
        self._clamp()
        match given.law:
            case RayleighDamping() as law:
                self._mass(law)
            case ModalDamping() as law:
                self._modal(law)
            case QuadraticDamping() as law:
                self._drag(law)
        self.sensors = [self._sensor(node) for node in (self.nodes if case.mode is not None else self.nodes[-1:])]
        self.mbs.Assemble()

    def coordinates(self) -> Array:
        """Return the sampled tip positions, or all nodal coordinates."""
        samples = [np.asarray(self.mbs.GetSensorStoredData(sensor))[:, 1:] for sensor in self.sensors]
        return samples[0][:, :2] if self.case.mode is None else np.hstack(samples)

    def _nodes(self) -> list[Any]:
        """Add the nodes in equilibrium, with or without the velocity of the clamp."""
        straight = self.given.model.straight.reshape(-1, NODE)
        displacement = self.given.rest.reshape(-1, NODE) - straight
        speed = [self.case.base.amplitude * 2 * math.pi * self.case.base.frequency, 0.0, 0.0, 0.0]
        moving = self.case.start != "impact"
        return [
            self.mbs.AddNode(
                self.items.NodePoint2DSlope1(
                    referenceCoordinates=straight[k],
                    initialCoordinates=displacement[k],
                    initialVelocities=speed if moving or k == 0 else [0.0] * NODE,
                )
            )
            for k in range(len(straight))
        ]

    def _cables(self) -> list[Any]:
        """Add the elements and their weight."""
        cables = []
        for k, section in enumerate(BEAM.sections):
            modulus = BEAM.elastic_modulus[k]
            cable = self.mbs.AddObject(
                self.items.ObjectANCFCable2D(
                    length=BEAM.element_lengths[k],
                    massPerLength=BEAM.density[k] * section.area,
                    axialStiffness=modulus * section.area,
                    bendingStiffness=modulus * section.second_moment,
                    nodeNumbers=self.nodes[k : k + 2],
                    useReducedOrderIntegration=2,
                )
            )
            marker = self.mbs.AddMarker(self.items.MarkerBodyMass(bodyNumber=cable))
            self.mbs.AddLoad(self.items.LoadMassProportional(markerNumber=marker, loadVector=[*BEAM.gravity, 0.0]))
            cables.append(cable)
        return cables

    def _clamp(self) -> None:
        """Drive the first node along x, then hold it; its other coordinates are held throughout."""
        sym, base = self.exu.symbolic, self.case.base
        amplitude, omega, stop = base.amplitude, 2 * math.pi * base.frequency, base.stop_time
        held = amplitude * math.sin(omega * stop)

        def place(mbs: Any, t: Any, item: Any, offset: Any) -> Any:
            return sym.IfThenElse(t < stop, amplitude * sym.sin(omega * t), sym.Real(held))

        def speed(mbs: Any, t: Any, item: Any, offset: Any) -> Any:
            return sym.IfThenElse(t < stop, amplitude * omega * sym.cos(omega * t), sym.Real(0.0))

        motion = {
            "offsetUserFunction": self._symbolic(place, "offsetUserFunction", "ObjectConnectorCoordinate"),
            "offsetUserFunction_t": self._symbolic(speed, "offsetUserFunction_t", "ObjectConnectorCoordinate"),
        }
        fixed = self.mbs.AddMarker(
            self.items.MarkerNodeCoordinate(nodeNumber=self.mbs.AddNode(self.items.NodePointGround()), coordinate=0)
        )
        for k in range(NODE):
            own = self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=self.nodes[0], coordinate=k))
            self.mbs.AddObject(
                self.items.ObjectConnectorCoordinate(markerNumbers=[fixed, own], **(motion if k == 0 else {}))
            )

    def _mass(self, law: RayleighDamping) -> None:
        model = self.given.model
        properties = model.groups[0].properties(model.properties).full()
        for k in range(BEAM.elements):
            matrix = law.alpha * model.element.mass(properties[:, k]).full()
            self._viscous(self.nodes[k : k + 2], matrix)

    def _modal(self, law: ModalDamping) -> None:
        projection = law.projection(self.given.model)
        rates = 4 * math.pi * np.array(law.frequencies) * np.array(law.ratios)
        self._viscous(self.nodes, projection * rates @ projection.T)

    def _viscous(self, nodes: list[Any], matrix: Array) -> None:
        """Add the damping forces of a matrix, which acts on absolute velocities."""
        self.mbs.AddObject(
            self.items.ObjectGenericODE2(nodeNumbers=nodes, massMatrix=np.zeros_like(matrix), dampingMatrix=matrix)
        )

    def _drag(self, law: QuadraticDamping) -> None:
        """Add drag at 2 Gauss points per element; ours uses 4, which agrees to 1e-6."""
        length, name = BEAM.element_lengths[0], "ObjectConnectorCartesianSpringDamper"
        share = BEAM.density[0] * BEAM.sections[0].area * length / 2
        linear = law.eta1 * share
        quadratic = law.eta2 * DRAG_CONSTANT * share
        sym = self.exu.symbolic

        def force(
            mbs: Any, t: Any, item: Any, displacement: Any, velocity: Any, stiffness: Any, damping: Any, offset: Any
        ) -> Any:
            size = linear + quadratic * sym.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1])
            return [size * velocity[0], size * velocity[1], sym.Real(0.0)]

        function = self._symbolic(force, "springForceUserFunction", name)
        still = self.mbs.AddMarker(self.items.MarkerBodyPosition(bodyNumber=self.ground))
        for cable in self.cables:
            for xi in gauss(2)[0].tolist():
                place = [xi * length, 0.0, 0.0]
                own = self.mbs.AddMarker(self.items.MarkerBodyPosition(bodyNumber=cable, localPosition=place))
                self.mbs.AddObject(
                    self.items.ObjectConnectorCartesianSpringDamper(
                        markerNumbers=[still, own], springForceUserFunction=function
                    )
                )

    def _sensor(self, node: Any) -> Any:
        kinds = self.exu.OutputVariableType
        return self.mbs.AddSensor(
            self.items.SensorNode(
                nodeNumber=node,
                storeInternal=True,
                writeToFile=False,
                outputVariableType=kinds.Position if self.case.mode is None else kinds.CoordinatesTotal,
            )
        )

    def _symbolic(self, function: Any, name: str, item: str) -> Any:
        made = self.items.CreateSymbolicUserFunction(self.mbs, function, name, itemTypeName=item)
        self.functions.append(made)
        return made


def _settings(exu: Any, duration: float, step: float) -> Any:
    """Return the best settings found for Exudyn."""
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.endTime = duration
    integration.numberOfSteps = round(duration / step)
    integration.verboseMode = 0
    integration.newton.useModifiedNewton = True
    integration.newton.modifiedNewtonJacUpdatePerStep = True
    integration.newton.relativeTolerance = 1e-6
    integration.newton.absoluteTolerance = 1e-8
    integration.generalizedAlpha.spectralRadius = 0.9
    integration.generalizedAlpha.computeInitialAccelerations = True
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.linearSolver.reuseAnalyzedPattern = True
    settings.parallel.numberOfThreads = 1
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 1 / SAMPLE_RATE
    return settings
