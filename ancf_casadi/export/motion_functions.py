"""The equation of motion as named CasADi Functions, for optimisation, control and user code, and their files.

With the free coordinates q, their velocities v and accelerations a in the laboratory frame, the motion ``base`` of the
supports (displacement x, y and rotation, then their velocities, then their accelerations) and the parameters p
(gravity, properties of the elements, parameters of the damping law), Eq. (6) with damping reads

    residual(q, v, a, base, p) = N^T (M e_tt + Q_damp + Q_e - Q_g),    e = N q + G b
    rhs(q, v, base, p) = a, the accelerations with zero residual,

in which the base b follows from ``base``, and N and G from the supports (``mechanics.model``).

The mass matrix, Eq. (7), depends on p but not on the motion, and couples x and y at slanted rollers only.  ``rhs``
factorises it in each call, in linear time.  ``signals`` names every entry of q, v, base and p.  All Functions are MX
Functions and differentiable.  ``solved_functions`` has ``equilibrium``, ``frequencies`` and ``step``.

Files of Functions are for temporary use on one machine.  CasADi reads only files of its own version, and to load a
Function is to run the program in it: load only files that you have saved yourself.  For storage and exchange, write the
JSON document of ``ancf_casadi.export``.

The first line of a file is JSON: the format, the kind of model, the version of CasADi, the length of the beam, and the
tables of signals.  The Functions follow in CasADi's format.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from types import NoneType
from typing import Any

import casadi as cs

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.equations import Balance, Equations
from ancf_casadi.dynamics.excitation import clamped_node
from ancf_casadi.dynamics.placed_load import LOAD_SIZE
from ancf_casadi.dynamics.signals import (
    MotionFunctions,
    Signal,
    base_signals,
    output_signals,
    parameter_signals,
    state_signals,
    values,
)
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.solved_functions import equilibrium_function, free_block, frequencies_function, step_function
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.reduction.reduced import ReducedFunctions
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_file, check_ours, open_file, write_file
from ancf_casadi.support.inputs import check_instance, numbers, whole
from ancf_casadi.vibration.modes import natural_modes
from ancf_casadi.vibration.statics import static_equilibrium

DYNAMIC_INPUTS = ("q", "v", "a", "base", "p")
MOTION_INPUTS = ("q", "v", "base", "p")
POSITION_INPUTS = ("q", "base")

TITLE = "ancf-casadi functions"
FUNCTIONS_FORMAT = f"{TITLE} 4"
FILE_START = f'{{"format": "{TITLE}'
SIGNAL_TABLES = ("parameters", "states", "base", "outputs")


@dataclass(frozen=True, eq=False)
class BeamFunctions(MotionFunctions):
    """A beam with a damping law as CasADi Functions; made by ``beam_functions``.

    Parameters
    ----------
    parameters, states, base, outputs, length, rhs, tip, markers, energies, clamp_force
        See ``MotionFunctions``; a is in m/s^2 and 1/s^2.
    residual : Function
        (q, v, a, base, p) -> r, N and N m.
    residual_jacobians : Function
        (q, v, a, base, p) -> dr_dq, dr_dv, dr_da, dr_dbase, dr_dp; sparse, except dr_dv under a modal (generic) law.
    mass : Function
        p -> M, sparse.
    tangent_stiffness : Function
        (q, base, p) -> K, the Jacobian of the elastic force, sparse.
    damping_force : Function
        (q, v, base, p) -> Q_damp, on the left of the equation of motion.
    equilibrium : Function
        p -> q at rest, with the base at rest; nan if none was found, or the beam can move rigidly.
    frequencies : Function
        p -> f, the lowest natural frequencies about the equilibrium, Hz; nan if they are not certain, as those of a
        beam that can move rigidly.
    step : Function
        (q, v, base, p, h) -> q_next, v_next after a step h (s); base (9, 2) at the instants ``SDIRK_STAGES`` of it.
    model, law : Model and DampingLaw
        The beam and its damping law; None if the Functions are from a file.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model
    >>> from ancf_casadi.export import beam_functions, values
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> functions = beam_functions(Model(beam), markers=[0.25])
    >>> functions.rhs.name_in(), functions.rhs.name_out()
    (['q', 'v', 'base', 'p'], ['a'])
    >>> functions.frequencies(values(functions.parameters)).full().ravel()[:2].round(2)
    array([ 1.88, 10.59])
    """

    residual: cs.Function
    residual_jacobians: cs.Function
    mass: cs.Function
    tangent_stiffness: cs.Function
    damping_force: cs.Function
    equilibrium: cs.Function
    frequencies: cs.Function
    model: Model | None = None
    law: DampingLaw | None = None


MODELS: dict[str, type[BeamFunctions | ReducedFunctions]] = {"full": BeamFunctions, "reduced": ReducedFunctions}


def beam_functions(
    model: Model, damping: DampingLaw | None = None, *, markers: Sequence[float] = (), modes: int = 5
) -> BeamFunctions:
    """Return the equation of motion of a beam as CasADi Functions.

    Parameters
    ----------
    model : Model
        The beam; its properties are the values of the parameters.
    damping : DampingLaw, optional
        The damping law; no damping if not given.
    markers : sequence of float
        Arc lengths of the points whose positions ``markers`` returns, m.
    modes : int
        Number of natural frequencies.

    Raises
    ------
    InputError
        If a marker is not on the beam, or the beam has fewer modes.
    EquilibriumError
        If the beam has no stable equilibrium under gravity.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping
    >>> from ancf_casadi.export import beam_functions, values
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> functions = beam_functions(Model(beam), RayleighDamping(alpha=0.2), modes=1)
    >>> p, state = values(functions.parameters), values(functions.states)
    >>> r = functions.residual(state[: functions.free], 0, 0, 0, p)  # at rest
    >>> bool(abs(r.full()).max() < 1e-6)
    True
    """
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    equations = Equations(model, RayleighDamping() if damping is None else damping)
    markers = numbers(markers, "markers")
    points = [cs.DM(model.interpolation(s)) for s in markers]
    static_state = static_equilibrium(model, loads=equations.flow)
    lowest_modes = natural_modes(model, count=whole(modes, "modes", 1, model.freedoms), equilibrium=static_state)
    parameters, size = parameter_signals(equations), model.freedoms
    sizes = {"q": size, "v": size, "a": size, "base": len(base_signals()), "p": len(parameters)}
    symbols = {name: cs.MX.sym(name, size) for name, size in sizes.items()}
    balance, node = equations.balance_for(symbols["p"]), _base_node(model, symbols["base"])
    e, e_t, e_tt = (model.whole(symbols[key], vector) for key, vector in zip("qva", node, strict=True))
    mass = free_block(model, model.mass(balance.properties))
    stiffness = free_block(model, model.tangent_stiffness(e, balance.properties))
    all_damping, conservative, inertia = balance.damping(e, e_t), balance.conservative(e), balance.inertia(e_tt)
    damping_force = model.of_free(all_damping)
    resisting_force = damping_force + model.of_free(conservative)
    force = model.of_free(inertia) + resisting_force
    # with zero acceleration of the free coordinates
    bias_force = model.of_free(balance.inertia(model.whole(cs.MX(size, 1), node[2]))) + resisting_force
    jacobians = {**_state_jacobians(balance, e, e_t), "dr_da": mass}
    input_jacobians = {f"dr_d{name}": _jacobian(force, symbols[name]) for name in ("base", "p")}

    def function(name: str, inputs: Sequence[str], **results: cs.MX) -> cs.Function:
        """Return a Function of some of the symbols, with named outputs."""
        return cs.Function(name, [symbols[key] for key in inputs], [*results.values()], [*inputs], [*results])

    residual = function("residual", DYNAMIC_INPUTS, r=force)
    equilibrium = equilibrium_function(lowest_modes, equations, values(parameters))
    return BeamFunctions(
        parameters=parameters,
        states=state_signals(lowest_modes.equilibrium),
        base=base_signals(),
        outputs=output_signals(markers),
        length=model.beam.length,
        residual=residual,
        residual_jacobians=function("residual_jacobians", DYNAMIC_INPUTS, **jacobians, **input_jacobians),
        rhs=function("rhs", MOTION_INPUTS, a=-_solve_mass_matrix(bias_force, mass, model)),
        mass=function("mass", ("p",), M=mass),
        tangent_stiffness=function("tangent_stiffness", (*POSITION_INPUTS, "p"), K=stiffness),
        damping_force=function("damping_force", MOTION_INPUTS, Q=damping_force),
        tip=function("tip", POSITION_INPUTS, r=cs.DM(model.interpolation(model.beam.length)) @ e),
        markers=function("markers", POSITION_INPUTS, r=cs.horzcat(cs.MX(2, 0), *(point @ e for point in points))),
        energies=function(
            "energies",
            MOTION_INPUTS,
            T=cs.dot(e_t, balance.inertia(e_t)) / 2,
            U=model.strain_energy(e, balance.properties),
            V=-cs.dot(e, model.gravity_force(balance.properties, balance.gravity)),
        ),
        clamp_force=function("clamp_force", DYNAMIC_INPUTS, F=model.of_base(inertia + all_damping + conservative)[:2]),
        equilibrium=equilibrium,
        frequencies=frequencies_function(lowest_modes, equations, equilibrium),
        step=step_function(
            residual,
            function("step_jacobians", DYNAMIC_INPUTS, **jacobians),
            (
                cs.diag(free_block(model, model.mass(model.properties))),
                cs.DM(lowest_modes.equilibrium.stiffness.diagonal()),
            ),
            model.beam.length,
        ),
        model=model,
        law=equations.law,
    )


def value_and_jacobian(expression: cs.MX, symbol: cs.MX, point: Array) -> tuple[Array, Array]:
    """Return the value (k,) of an expression of a symbol (n,) at a point, and its Jacobian (k, n)."""
    results = cs.Function("value_and_jacobian", [symbol], [expression, cs.jacobian(expression, symbol)])(point)
    value, jacobian = (result.full() for result in results)
    return value.ravel(), jacobian


def jacobian_at_rest(functions: MotionFunctions) -> Array:
    """Return the Jacobian of the accelerations with respect to the free coordinates, (n, n), at rest."""
    q, n = cs.MX.sym("q", functions.free), functions.free
    rest_inputs = cs.MX(n, 1), cs.MX(len(functions.base), 1), cs.MX(cs.DM(values(functions.parameters)))
    return value_and_jacobian(functions.rhs(q, *rest_inputs), q, values(functions.states)[:n])[1]


def _base_node(model: Model, base: cs.MX) -> list[cs.MX]:
    """Return position, velocity and acceleration of the base node, which follow from its displacement and rotation."""
    position, velocity, acceleration = cs.vertsplit(base, 3)
    t = cs.MX.sym("t")
    displacement = position + velocity * t + acceleration * t**2 / 2
    (node,) = cs.graph_substitute([clamped_node(model, displacement, t)], [t], [cs.MX(0.0)])
    vectors: list[cs.MX] = cs.vertsplit(node, NODE)
    return vectors


def _state_jacobians(balance: Balance, e: cs.MX, e_t: cs.MX) -> dict[str, cs.MX]:
    """Return the Jacobians dr_dq and dr_dv; the low-rank damping does not depend on q."""
    model = balance.equations.model
    dr_dq, dr_dv, _ = (model.free_matrix(entries) for entries in balance.tangents(e, e_t, cs.MX(LOAD_SIZE, 1)))
    if balance.projection.numel():
        turned = model.of_free(balance.turned_projection(e))
        dr_dv += turned @ cs.diag(balance.modal_coefficients) @ turned.T
    return {"dr_dq": dr_dq, "dr_dv": dr_dv}


def _jacobian(expression: cs.MX, symbol: cs.MX) -> cs.MX:
    """Return a Jacobian computed one directional derivative at a time, which keeps the C code short."""
    return cs.jacobian(expression, symbol, {"helper_options": {"max_num_dir": 1}})


def _solve_mass_matrix(forces: cs.MX, mass: cs.MX, model: Model) -> cs.MX:
    """Return M^-1 Q; if x and y have the same mass matrix, factorise it once for both."""
    x, y = slice(0, None, 2), slice(1, None, 2)
    model_mass = free_block(model, model.mass(model.properties))
    odd_count = bool(model.freedoms % 2)
    if odd_count or cs.norm_inf(model_mass[x, y]) > 0 or cs.norm_inf(model_mass[x, x] - model_mass[y, y]) > 0:
        return cs.solve(mass, forces, "ldl")
    accelerations = cs.solve(mass[x, x], cs.horzcat(forces[x], forces[y]), "ldl")
    return cs.vec(accelerations.T)


def save_functions(functions: BeamFunctions | ReducedFunctions, path: str | Path) -> None:
    """Save the Functions to a file, usually named ``.casadi``; an earlier file of this kind is replaced.

    The file of a ``ReducedModel`` holds its Functions and tables, but not its modes and its damping law.

    Raises
    ------
    InputError
        If the file exists and is of another kind, or it cannot be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi import Beam, Model, reduce_model
    >>> from ancf_casadi.export import save_functions
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> save_functions(reduce_model(Model(beam), modes=2), "reduced.casadi")
    >>> Path("reduced.casadi").exists()
    True
    """
    check_instance(functions, "functions", *MODELS.values())
    target = check_file(path)
    check_ours(target, FILE_START)
    tables = {name: [asdict(signal) for signal in getattr(functions, name)] for name in SIGNAL_TABLES}
    (kind,) = (name for name, model_class in MODELS.items() if isinstance(functions, model_class))
    header = {"format": FUNCTIONS_FORMAT, "model": kind, "casadi": cs.CasadiMeta.version(), "length": functions.length}
    serializer = cs.StringSerializer()
    for function in functions.functions:
        serializer.pack(function)
    write_file(target, f"{json.dumps(header | tables)}\n{serializer.encode()}")


def load_functions(path: str | Path) -> BeamFunctions | ReducedFunctions:
    """Load the Functions from a file that ``save_functions`` wrote.

    Raises
    ------
    InputError
        If the file cannot be read, is of another kind, is damaged, or was written with another version of CasADi.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model
    >>> from ancf_casadi.export import beam_functions, load_functions, save_functions
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> save_functions(beam_functions(Model(beam)), "beam.casadi")
    >>> functions = load_functions("beam.casadi")
    >>> functions.rhs.name_in()
    ['q', 'v', 'base', 'p']
    """
    where = str(path)
    with open_file(path) as file:
        content = file.read()
    try:
        header_line, _, serialized = content.decode().partition("\n")
        header = json.loads(header_line)
        if header["format"] != FUNCTIONS_FORMAT:
            raise ValueError(header["format"])
        writer_version, kind, length = header["casadi"], header["model"], float(header["length"])
        names = [field.name for field in fields(MODELS[kind]) if field.type == "cs.Function"]
        tables: dict[str, Any] = {name: tuple(Signal(**entry) for entry in header[name]) for name in SIGNAL_TABLES}
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError("is not a file of Functions of this version; export it again", where) from None
    if writer_version != cs.CasadiMeta.version():
        raise InputError(
            f"was written by CasADi {writer_version}, but {cs.CasadiMeta.version()} is in use; export it again", where
        )
    try:
        deserializer = cs.StringDeserializer(serialized)
        functions: dict[str, Any] = {name: deserializer.unpack() for name in names}
    except RuntimeError:
        raise InputError("is damaged; export it again", where) from None
    return MODELS[kind](**tables, length=length, **functions)
