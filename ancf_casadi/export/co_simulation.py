"""The beam as a co-simulation unit with its own integrator: two Functions for ``co_simulation.c``, which chooses h.

    advance(x, u, p, h) -> x after a step h (s), and its estimated error
    observe(x, u, p) -> y, the outputs

    x       q, v of the Functions, displacement and rotation of the base, and their velocities
    u       accelerations of the base, and a force F at the tip, both constant from one communication to the next

With r_tip(q) the position of the tip, the force adds (dr_tip/dq)^T F to the equation of motion.  The motion of the base
follows exactly from its constant accelerations.

The full beam takes steps of the method of Kennedy and Carpenter, of order 4 (``solved_functions``).  The reduced model
takes two steps of Lawson's method (``reduction.reduced``) of half the length; their difference from one step, divided
by 15, is the error, and is added (Richardson's extrapolation).

The error is the largest displacement of a node under the error of q, or under the error of v times h.  It is relative
to the length of the beam.
"""

from __future__ import annotations

import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.signals import MotionFunctions, Signal, values
from ancf_casadi.export.motion_functions import BeamFunctions, jacobian_at_rest, value_and_jacobian
from ancf_casadi.export.solved_functions import (
    KENNEDY_CARPENTER,
    KENNEDY_CARPENTER_ERROR,
    stage_instants,
    step_function,
)
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.reduction.reduced import lawson_step

WRAPPER = Path(__file__).with_suffix(".c")
BASE_COORDINATES = 3  # coordinates of the base: x, y and rotation
BASE_STATES = 2 * BASE_COORDINATES  # position and velocity of the base
LOAD = tuple(Signal(f"tip_force_{c}", "N", f"force at the tip, {c}") for c in "xy")
LAWSON_INSTANTS = (0.0, 0.5, 1.0)
FUNCTION_TYPE = re.compile(r"typedef\s+(fmi3\w+)\s+(fmi3\w+)TYPE\s*\(([^;]*)\);")


def advance_function(functions: MotionFunctions) -> cs.Function:
    """Return (x, u, p, h) -> x_next, error."""
    x, u, p = symbols = _symbols(functions)
    h, n = cs.MX.sym("h"), functions.free
    q, v, place, velocity = cs.vertsplit(x, [0, n, 2 * n, 2 * n + BASE_COORDINATES, x.numel()])
    a, parameters = u[:BASE_COORDINATES], cs.vertcat(p, u[BASE_COORDINATES:])

    def base(begin: cs.MX | float, length: cs.MX, instants: Sequence[float]) -> cs.MX:
        """Return the motion of the base at instants of a step."""
        times = [begin + length * instant for instant in instants]
        return cs.horzcat(*(cs.vertcat(place + velocity * t + a * t**2 / 2, velocity + a * t, a) for t in times))

    weights = _error_weights(functions)
    if isinstance(functions, BeamFunctions):
        step = _stiff_step(functions)
        *state, q_error, v_error = step(q, v, base(0.0, h, stage_instants(KENNEDY_CARPENTER)), parameters, h)
    else:
        step = _lawson_step(functions)
        coarse = step(q, v, base(0.0, h, LAWSON_INSTANTS), parameters, h)
        middle = step(q, v, base(0.0, h / 2, LAWSON_INSTANTS), parameters, h / 2)
        fine = step(*middle, base(h / 2, h / 2, LAWSON_INSTANTS), parameters, h / 2)
        q_error, v_error = ((f - c) / 15 for f, c in zip(fine, coarse, strict=True))
        state = [fine[0] + q_error, fine[1] + v_error]
    error = cs.norm_inf(cs.vertcat(weights * q_error, weights * h * v_error))
    x_next = cs.vertcat(*state, base(0.0, h, (1.0,))[:BASE_STATES])
    return cs.Function("advance", [*symbols, h], [x_next, error])


def observe_function(functions: MotionFunctions) -> cs.Function:
    """Return (x, u, p) -> y."""
    (q, v, _, base, loaded), (*_, p), _ = _motion_symbols(functions)
    a, tip = _loaded_rhs(functions)(q, v, base, loaded), functions.tip(q, base)
    # zero for the full beam, unless a support holds the tip
    tip_reaction = cs.jtimes(tip, base, loaded[-len(LOAD) :], True)[: len(LOAD)]
    clamp_force = functions.clamp_force(q, v, a, base, p) - tip_reaction
    y = cs.vertcat(tip, cs.vec(functions.markers(q, base)), *functions.energies(q, v, base, p), clamp_force)
    outputs = cs.Function("outputs", [q, v, base, loaded], [y])
    x, u, p = symbols = _symbols(functions)
    state = cs.vertsplit(x, [0, functions.free, 2 * functions.free, x.numel()])
    base_acceleration, force = cs.vertsplit(u, [0, BASE_COORDINATES, u.numel()])
    y = outputs(state[0], state[1], cs.vertcat(state[2], base_acceleration), cs.vertcat(p, force))
    return cs.Function("observe", symbols, [y])


def _symbols(functions: MotionFunctions) -> list[cs.MX]:
    """Return symbols of x, u and p."""
    sizes = len(functions.states) + BASE_STATES, BASE_COORDINATES + len(LOAD), len(functions.parameters)
    return [cs.MX.sym(name, size) for name, size in zip("xup", sizes, strict=True)]


def _motion_symbols(functions: MotionFunctions) -> tuple[list[cs.MX], list[cs.MX], cs.MX]:
    """Return the symbols q, v, a, base and (p, F); the same with p alone; and the generalised force of F."""
    sizes = {name: functions.free for name in ("q", "v", "a")}
    sizes |= {"base": len(functions.base), "p": len(functions.parameters) + len(LOAD)}
    *motion, loaded = symbols = [cs.MX.sym(name, size) for name, size in sizes.items()]
    tip, force = functions.tip(motion[0], motion[3]), loaded[-len(LOAD) :]
    return symbols, [*motion, loaded[: -len(LOAD)]], cs.jtimes(tip, motion[0], force, True)


def _loaded_rhs(functions: MotionFunctions) -> cs.Function:
    """Return (q, v, base, (p, F)) -> a."""
    (q, v, _, base, loaded), (*_, p), force = _motion_symbols(functions)
    mass = functions.named["mass"]
    M = mass(p if mass.name_in(0) == "p" else q)
    a = functions.rhs(q, v, base, p) + cs.solve(M, force, "ldl")
    return cs.Function("loaded_rhs", [q, v, base, loaded], [a], ["q", "v", "base", "p"], ["a"])


def _stiff_step(functions: BeamFunctions) -> cs.Function:
    """Return (q, v, base, (p, F), h) -> q_next, v_next and their errors."""
    symbols, motion_inputs, force = _motion_symbols(functions)
    names, p = ["q", "v", "a", "base", "p"], values(functions.parameters)
    residual = cs.Function("loaded_residual", symbols, [functions.residual(*motion_inputs) - force], names, ["r"])
    state_jacobians = functions.residual_jacobians.call(motion_inputs, True, False)[:3]
    jacobians = cs.Function("loaded_jacobians", symbols, state_jacobians)
    K = functions.tangent_stiffness(values(functions.states)[: functions.free], np.zeros(len(functions.base)), p)
    diagonals = cs.diag(functions.mass(p)), cs.diag(K)
    method = KENNEDY_CARPENTER, KENNEDY_CARPENTER_ERROR
    return step_function(residual, jacobians, diagonals, functions.length, *method, _loaded_rhs(functions))


def _lawson_step(functions: MotionFunctions) -> cs.Function:
    """Return (q, v, base, (p, F), h) -> q_next, v_next."""
    return lawson_step(_loaded_rhs(functions), np.sqrt(np.abs(jacobian_at_rest(functions).diagonal())))


def _error_weights(functions: MotionFunctions) -> cs.DM:
    """Return the largest displacement of a node per unit of each coordinate, relative to the length of the beam."""
    if isinstance(functions, BeamFunctions):
        displacements = np.array([signal.unit == "m" for signal in functions.states[: functions.free]], dtype=float)
    else:
        q, base_at_rest = cs.MX.sym("q", functions.free), cs.MX(len(functions.base), 1)
        e, _ = functions.named["coordinates"](q, cs.MX(functions.free, 1), base_at_rest)
        nodes, jacobian = value_and_jacobian(e, q, np.zeros(functions.free))
        displacements = np.abs(jacobian[np.arange(len(nodes)) % NODE < 2]).max(axis=0)
    return cs.DM(displacements / functions.length)


def co_simulation_source(functions: MotionFunctions, tolerance: str, headers: Path) -> tuple[str, str]:
    """Return the C source, and the token that an importer must give, a digest of this source.

    Functions that the FMI ``headers`` declare and ``co_simulation.c`` does not implement refuse their call.
    """
    generated = [advance_function(functions), observe_function(functions)]
    generator = cs.CodeGenerator("beam.c", {"with_export": False})
    for function in generated:
        generator.add(function)
    start = values((*functions.parameters, *functions.states, *functions.base[:BASE_STATES])).tolist()
    constants = {
        "PARAMETERS": len(functions.parameters),
        "STATES": len(functions.states) + BASE_STATES,
        "INPUTS": BASE_COORDINATES + len(LOAD),
        "OUTPUTS": len(functions.outputs),
        "TOLERANCE": tolerance,
    }
    constants |= {
        f"WORK_{name.upper()}": 1 + max(getattr(function, f"sz_{name}")() for function in generated)
        for name in ("arg", "res", "iw", "w")
    }
    lines = [f"#define {name} {value}" for name, value in constants.items()]
    wrapper = WRAPPER.read_text()
    missing_functions = [
        f"{kind} {name}({arguments}) {{ return {'refuse(instance)' if kind == 'fmi3Status' else 'NULL'}; }}"
        for kind, name, arguments in FUNCTION_TYPE.findall((headers / "fmi3FunctionTypes.h").read_text())
        if f" {name}(" not in wrapper
    ]
    lines.append(f"static const double at_start[] = {{{', '.join(map(repr, start))}}};")
    source = "\n".join([generator.dump(), *lines, wrapper, *missing_functions, ""])
    token = hashlib.sha256(source.encode()).hexdigest()
    return f'#define TOKEN "{token}"\n{source}', token


def co_simulation_description(functions: MotionFunctions, name: str, token: str) -> ET.Element:
    """Return the description of the model with the signals and the capabilities of ``co_simulation.c``."""
    root = ET.Element("fmiModelDescription", fmiVersion="3.0", instantiationToken=token)
    capabilities = ("canHandleVariableCommunicationStepSize", "canGetAndSetFMUState", "canSerializeFMUState")
    ET.SubElement(root, "CoSimulation", {"modelIdentifier": name, **dict.fromkeys(capabilities, "true")})
    categories = ET.SubElement(root, "LogCategories")
    for category in ("logStatus", "logStatusError"):
        ET.SubElement(categories, "Category", name=category)
    variables, structure = ET.SubElement(root, "ModelVariables"), ET.SubElement(root, "ModelStructure")
    groups = (
        ({"causality": "independent"}, (Signal("time", "s", "time"),)),
        ({"causality": "parameter", "variability": "tunable", "initial": "exact"}, functions.parameters),
        ({"causality": "local", "initial": "exact"}, (*functions.states, *functions.base[:BASE_STATES])),
        ({"causality": "input"}, (*functions.base[BASE_STATES:], *LOAD)),
        ({"causality": "output", "initial": "calculated"}, functions.outputs),
    )
    for common, signals in groups:
        for signal in signals:
            names = {"name": signal.name, "valueReference": str(len(variables)), "description": signal.description}
            attributes = names | common | ({"unit": signal.unit} if signal.unit != "1" else {})
            attributes |= {} if common["causality"] in ("independent", "output") else {"start": repr(signal.value)}
            ET.SubElement(variables, "Float64", attributes)
    for element in ("Output", "InitialUnknown"):
        for variable in variables:
            if variable.attrib["causality"] == "output":
                ET.SubElement(structure, element, valueReference=variable.attrib["valueReference"])
    return root
