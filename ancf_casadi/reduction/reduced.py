"""The reduced model as CasADi Functions of a few modal coordinates.

    M(q) q_tt = -h(q, q_t, base, p)

is Eq. (6) with damping, projected on the bending modes (``forces``).  It keeps the large bending, the inertia, gravity
and damping of the beam.  It has no axial waves, which would limit the steps of an explicit integrator: the beam does
not stretch, or stretches as in a slow motion where supports hold it at several places.  In small motion about rest, it
has the modes of the full beam.  ``docs/reduction.md`` shows how the error grows with amplitude.

All Functions are sequences of scalar operations on short vectors, which makes them fast as C code.  M is factored as
L D L^T.  ``write_c``, ``save_functions`` and ``write_fmu`` export them like those of the full model, and
``write_c(beam_functions(model, law), folder, also=reduced.functions)`` writes both models to one C file.

Time step.  With the natural angular frequencies w_k, q_tt = -w^2 q + N(q, q_t, t).  Lawson's method integrates the
linear part by its exact flow E(t), and the remainder N by the classical Runge-Kutta method of order 4:

    k1 = N(x),  k2 = N(E(h/2)(x + h/2 k1)),  k3 = N(E(h/2) x + h/2 k2),  k4 = N(E(h) x + h E(h/2) k3),
    x_next = E(h)(x + h/6 k1) + h/3 E(h/2)(k2 + k3) + h/6 k4.

Small undamped motion is exact with any step; only nonlinear and damping forces require short steps.

References
----------
Lawson 1967, "Generalized Runge-Kutta processes for stable systems with large Lipschitz constants", SIAM Journal on
Numerical Analysis 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import NoneType

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.signals import (
    MotionFunctions,
    Signal,
    base_signals,
    modal_signals,
    output_signals,
    parameter_signals,
    values,
)
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.supports import can_slide
from ancf_casadi.reduction.bending import (
    BendingMotion,
    SlopeProjection,
    displaced_slopes,
    is_held_at_begin_only,
    nodal_slopes,
    project_model,
    select_points,
)
from ancf_casadi.reduction.condensed import CondensedMotion, CondensedProjection, condensed_projection
from ancf_casadi.reduction.forces import BASE_SIZE, Expression, Projection, ReducedMotion
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.inputs import check_instance, numbers, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import plural
from ancf_casadi.vibration.assembly import Structure
from ancf_casadi.vibration.equilibrium import Equilibrium, neighbouring_equilibrium
from ancf_casadi.vibration.modes import Modes, natural_modes
from ancf_casadi.vibration.statics import static_equilibrium

MAX_DRAG_POINTS = 100
BASE_INSTANTS = 3  # instants of a step at which the base motion enters: start, middle, end


@dataclass(frozen=True, eq=False)
class ReducedFunctions(MotionFunctions):
    """A beam in a few modes as CasADi Functions, called ``reduced_rhs`` and so on.

    q (m,) are the modal coordinates of the mass-normalised modes, m kg^1/2; v are their velocities.  ``base`` (9,) is
    the displacement (x, y; m) and rotation (rad) of the clamp, then their velocities, then their accelerations.
    p (2 + l,) is gravity (x, y; m/s^2) and the parameters of the damping law.

    Parameters
    ----------
    parameters, states, base, outputs, length, rhs, tip, markers, energies, clamp_force
        As in ``MotionFunctions``; a is q_tt, m kg^1/2/s^2.
    step : Function
        (q, v, base, p, h) -> q_next, v_next after h seconds, with base (9, 3) at the start, middle and end of the step.
    mass : Function
        (q) -> M.
    coordinates : Function
        (q, v, base) -> e, e_t, nodal coordinates and velocities of the full model, (4 n + 4,).

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, reduce_model
    >>> from ancf_casadi.export import load_functions, save_functions
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> save_functions(reduce_model(Model(beam), modes=2), "reduced.casadi")
    >>> functions = load_functions("reduced.casadi")
    >>> type(functions).__name__, functions.mass([0.0, 0.0]).shape
    ('ReducedFunctions', (2, 2))
    """

    mass: cs.Function
    coordinates: cs.Function


@dataclass(frozen=True, eq=False)
class Reduction:
    """Modes, damping law and constants of a reduced model, without its Functions."""

    modes: Modes
    law: DampingLaw
    projection: Projection

    @property
    def model(self) -> Model:
        """The full model."""
        return self.modes.model

    @property
    def count(self) -> int:
        """Number of modes m."""
        return self.modes.count


@dataclass(frozen=True, eq=False)
class ReducedModel(ReducedFunctions, Reduction):
    """A beam in a few modes, with these modes and its damping law; ``reduce_model`` returns it.

    Parameters
    ----------
    modes : Modes
        The modes kept.
    law : DampingLaw
        The damping law.
    projection : Projection
        Constants of the equation of motion.
    parameters, states, base, outputs, length, rhs, step, mass, energies, clamp_force, tip, markers, coordinates
        As in ``ReducedFunctions``.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2, damping=RayleighDamping(alpha=0.2))
    >>> [state.name for state in reduced.states]
    ['q_1', 'q_2', 'velocity_q_1', 'velocity_q_2']
    >>> reduced.rhs.name_in()
    ['q', 'v', 'base', 'p']
    """

    @property
    def values(self) -> Array:
        """The values of p."""
        return values(self.parameters)

    def _summary(self) -> str:
        return f"{self.modes._summary()}, {plural(self.model.beam.elements, 'element')}, {self.law!r}"


@lasting_interrupts()
def reduce_model(
    model: Model,
    *,
    modes: int | Modes = 5,
    damping: DampingLaw | None = None,
    markers: Sequence[float] = (),
    slope_points: int | None = None,
    drag_points: int | None = None,
) -> ReducedModel:
    """Return the reduced model of a beam.

    If one clamp or pin holds the beam at its beginning, it does not stretch and may bend far.  Otherwise the motion
    along the beam follows the modes as a quadratic function, which stiffens a beam whose ends cannot approach each
    other; this holds for moderate amplitudes, up to about a tenth of the length.

    Parameters
    ----------
    model : Model
        The full model.
    modes : int or Modes
        The modes kept.  An int m keeps the m lowest modes about the equilibrium under gravity and a flow.  ``Modes``
        are kept as they are, and their equilibrium is the state of rest.  Where supports hold the beam beyond its
        beginning, at most 12.
    damping : DampingLaw, optional
        The damping law; undamped if not given.  ``RayleighDamping(stiffness="reference")`` is refused.
    markers : sequence of float
        Arc lengths of observed points, m.  The Function ``markers`` returns their positions.
    slope_points : int, optional
        Number of points at which the slope is evaluated: more than m, and at most the 2 n + 1 nodes and midpoints;
        2 m + 2 if not given.  Only for a beam that is held at its beginning alone.
    drag_points : int, optional
        Number of points at which the quadratic drag acts, at most 100; 4 m + 4 if not given.

    Raises
    ------
    InputError
        If the modes belong to another model, stretch the beam or move it without bending, a number of points is out of
        its range, a marker is not on the beam, or the damping law needs a force that the reduced model does not have.
    EquilibriumError
        If there is no stable equilibrium under gravity.

    Examples
    --------
    >>> from ancf_casadi import Beam, ModalDamping, Model, natural_modes, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model = Model(beam)
    >>> modes = natural_modes(model, count=3)
    >>> law = ModalDamping(modes, ratios=(0.01, 0.003, 0.003))
    >>> reduced = reduce_model(model, modes=modes, damping=law)
    >>> reduced.count, model.size
    (3, 20)
    """
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    law = RayleighDamping() if damping is None else damping
    if not isinstance(modes, Modes):
        equilibrium = static_equilibrium(model, loads=law.loads(model.beam))
        modes = natural_modes(model, count=whole(modes, "modes", 1, model.freedoms), equilibrium=equilibrium)
    if modes.model != model:
        raise InputError("belong to another model", "modes")
    if not modes.frequencies[0]:
        raise InputError("mode 1 is a motion without bending, which nothing holds; add a support or a spring", "modes")
    m, default_drag_points = modes.count, min(4 * modes.count + 4, MAX_DRAG_POINTS)
    drag_points = default_drag_points if drag_points is None else whole(drag_points, "drag_points", 1, MAX_DRAG_POINTS)
    max_slope_points = 2 * model.beam.elements + 1 + model.root
    if slope_points is None:
        slope_points = min(2 * m + 2, max_slope_points)
    elif is_held_at_begin_only(model):
        slope_points = whole(slope_points, "slope_points", m + 1, max_slope_points)
    else:
        raise InputError("have no meaning where supports hold the beam beyond its beginning", "slope_points")
    projection = _project_modes(modes, drag_points, slope_points)
    return _assemble_model(Reduction(modes, law, projection), numbers(markers, "markers"))


def _project_modes(modes: Modes, drag_points: int, slope_points: int, rows: Index | None = None) -> Projection:
    """Return the constants of a beam, with slopes at a number of points or at given ones if it does not stretch."""
    if not is_held_at_begin_only(modes.model):
        return condensed_projection(modes, drag_points)
    nodal = nodal_slopes(modes)
    selected = displaced_slopes(select_points(nodal, slope_points, rows), modes.model)
    return project_model(modes, displaced_slopes(nodal, modes.model), selected, drag_points)


def reduced_motion(
    projection: Projection, q: Expression, v: Expression, base: Expression, gravity: Expression
) -> ReducedMotion:
    """Return a motion of a reduced beam."""
    if isinstance(projection, CondensedProjection):
        return CondensedMotion(projection, q, v, base, gravity)
    assert isinstance(projection, SlopeProjection)
    return BendingMotion(projection, q, v, base, gravity)


def rebuild_reduction(reduction: Reduction, model: Model) -> Reduction:
    """Return the reduction of a beam with other properties, with as many modes and the same points."""
    loads, drag_points = reduction.law.loads(model.beam), len(reduction.projection.drag_mass)
    position = neighbouring_equilibrium(Structure.of(model, loads), reduction.modes.equilibrium.exact)
    equilibrium = None
    if position is not None:
        equilibrium = Equilibrium(model, position.coordinates, remainder=position.remainder, loads=loads)
    modes = natural_modes(model, count=reduction.count, equilibrium=equilibrium)
    rows = reduction.projection.slopes.rows if isinstance(reduction.projection, SlopeProjection) else np.empty(0, int)
    return Reduction(modes, reduction.law, _project_modes(modes, drag_points, len(rows), rows))


def reduced_parameters(reduced: Reduction) -> tuple[Signal, ...]:
    """Return gravity and the parameters of the damping law."""
    signals = parameter_signals(Equations(reduced.model, reduced.law))
    return *signals[:2], *signals[2 + reduced.model.properties.size :]  # without the properties of the elements


def _assemble_model(reduced: Reduction, markers: Sequence[float]) -> ReducedModel:
    """Return the reduced model with its Functions."""
    modes, law, projection, parameters = reduced.modes, reduced.law, reduced.projection, reduced_parameters(reduced)
    model, m = modes.model, modes.count
    sizes = {"q": m, "v": m, "a": m, "base": BASE_SIZE, "p": len(parameters)}
    inputs = {name: cs.SX.sym(name, size) for name, size in sizes.items()}
    q, v, acceleration, base, p = inputs.values()
    motion = reduced_motion(projection, q, v, base, p[:2])
    e = motion.nodal(*motion.parts, base[:2])
    e_t = motion.nodal(*motion.part_rates, base[3:5])
    M = reduced_motion(projection, q, v, cs.SX.zeros(BASE_SIZE), p[:2]).mass  # the same at any position of the base
    T, U, V = motion.energies
    damping = motion.damping(law, p[2:], model)
    forces = (motion.undamped_forces(cs.SX.zeros(m)) + damping)[:m]
    resultant = (motion.undamped_forces(acceleration) + damping)[m:]
    positions = cs.horzcat(cs.SX(2, 0), *(cs.DM(model.interpolation(s)) @ e for s in markers))

    D, LT, permutation = cs.ldl(motion.mass)
    a = cs.cse(cs.ldl_solve(-forces, D, LT, permutation))

    def function(name: str, arguments: str, **outputs: cs.SX) -> cs.Function:
        names = arguments.split()
        symbols = [inputs[argument] for argument in names]
        return cs.Function(f"reduced_{name}", symbols, [*outputs.values()], names, [*outputs])

    rhs = function("rhs", "q v base p", a=a)
    return ReducedModel(
        modes=modes,
        law=law,
        projection=projection,
        parameters=parameters,
        states=modal_signals(modes.frequencies.tolist()),
        base=base_signals(turns=not can_slide(modes.model.beam.supports)),
        outputs=output_signals(markers),
        length=model.beam.length,
        rhs=rhs,
        step=lawson_step(rhs, modes.angular_frequencies),
        mass=function("mass", "q", M=M),
        energies=function("energies", "q v base p", T=T, U=U, V=V),
        clamp_force=function("clamp_force", "q v a base p", F=resultant),
        tip=function("tip", "q base", r=e[-4:-2]),
        markers=function("markers", "q base", r=positions),
        coordinates=function("coordinates", "q v base", e=e, e_t=e_t),
    )


def lawson_step(rhs: cs.Function, angular_frequencies: Array) -> cs.Function:
    """Return one step of Lawson's method as a Function (q, v, base, p, h) -> q_next, v_next.

    The motion of the base is that at the start, the middle and the end of the step h, s; the angular frequencies,
    rad/s, are positive.
    """
    q, v, p = (cs.MX.sym(name, rhs.numel_in(name)) for name in ("q", "v", "p"))
    base, h, omega = cs.MX.sym("base", BASE_SIZE, BASE_INSTANTS), cs.MX.sym("h"), cs.DM(angular_frequencies)
    cosine, sine = cs.cos(omega * h / 2), cs.sin(omega * h / 2)

    def flow(x: cs.MX) -> cs.MX:
        """Return E(h/2) x."""
        return cs.horzcat(cosine * x[:, 0] + sine / omega * x[:, 1], cosine * x[:, 1] - sine * omega * x[:, 0])

    def remainder(x: cs.MX, instant: int) -> cs.MX:
        """Return N(x), what the linear restoring force leaves of the acceleration."""
        return cs.horzcat(cs.MX.zeros(q.numel()), rhs(x[:, 0], x[:, 1], base[:, instant], p) + omega**2 * x[:, 0])

    x = cs.horzcat(q, v)  # the state
    k1 = remainder(x, 0)
    k2 = remainder(flow(x + h / 2 * k1), 1)
    k3 = remainder(flow(x) + h / 2 * k2, 1)
    k4 = remainder(flow(flow(x) + h * k3), 2)
    x_next = flow(flow(x + h / 6 * k1) + h / 3 * (k2 + k3)) + h / 6 * k4
    return cs.Function("reduced_step", [q, v, base, p, h], [x_next[:, 0], x_next[:, 1]], ["q", "v", "base", "p", "h"],
                       ["q_next", "v_next"])  # fmt: skip
