"""The beam as a script of Exudyn: the same elements, ``ObjectANCFCable2D``, with the same measures of strain.

    elements        those of the beam, with useReducedOrderIntegration=2, whose axial strain is taken at other points
    beta            bendingDamping = beta E I, axialDamping = beta E A
    alpha, eta1     a damping matrix per element, multiples of its mass matrix (``ObjectGenericODE2``)
    eta2            a symbolic user function of a ``CartesianSpringDamper`` at two Gauss points per element
    modal           one damping matrix over all nodes, B diag(2 zeta omega) B^T with B = M Phi
    point mass      an ``ObjectGenericODE2`` at its node

The integrator is generalised alpha with a spectral radius of 0.6.  About equilibrium, with v = q_t and accelerations a
that satisfy the equation of motion, it computes an auxiliary acceleration w and (Chung and Hulbert)

    (1 - am) w' + am w = (1 - af) a' + af a,
    q' = q + h v + h^2 ((1/2 - b) w + b w'),    v' = v + h ((1 - g) w + g w').

References
----------
J. Chung, G. M. Hulbert, A time integration algorithm for structural dynamics with improved numerical dissipation: the
generalized-alpha method, Journal of Applied Mechanics 60 (1993).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping, SumOfLaws
from ancf_casadi.damping.law import law_terms
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.settings import (
    ExportedBeam,
    check_request,
    damping_coefficients,
    equal_speed_amplitudes,
    longest_step,
    write_template,
)
from ancf_casadi.mechanics.attachments import PointMass
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.modes import Modes, natural_modes

LOBATTO = ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6))
SPECTRAL_RADIUS = 0.6  # with 0.9, waves along the stiff beam let Newton's method fail at long steps


@dataclass(frozen=True)
class CableMeasures(StrainMeasures):
    """The strain measures of Exudyn's cable: those of this project, with the axial strain at Lobatto's three points."""

    @property
    def axial_rule(self) -> Sequence[tuple[float, float]]:
        """The points of the axial term and their weights."""
        return LOBATTO


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
    request = check_request("exudyn.py.jinja", model, path, damping, None, tolerance, amplitude)
    beam, modes = model.beam, request.modes
    if not (isinstance(beam.supports[0], Clamp) and math.isinf(beam.supports[0].stiffness)):
        raise InputError("must be a rigid clamp, to be written for exudyn", "supports")
    masses_only = all(isinstance(attachment, PointMass) for attachment in beam.attachments)
    if not masses_only or model.measures != StrainMeasures() or beam.rotary_sections:
        unwritten = "springs, dashpots, strain measures or rotary sections"
        raise InputError(f"has {unwritten} that cannot be written for exudyn", "model")
    terms = law_terms(request.damping)
    modal = [term for term in terms if isinstance(term, ModalDamping)]
    coefficients = damping_coefficients((term for term in terms if term not in modal), modes, request.amplitude)
    rayleigh = RayleighDamping(coefficients.alpha, coefficients.beta)
    written_law = SumOfLaws((rayleigh, QuadraticDamping(coefficients.eta1, coefficients.eta2), *modal))
    cable_modes = natural_modes(Model(beam, CableMeasures()), count=modes.count)
    ratios = written_law.damping_ratios(cable_modes, equal_speed_amplitudes(modes, request.amplitude))

    def transition_matrix(mode: int, step: float) -> Array:
        blocks = map(_generalised_alpha, cable_modes.angular_frequencies, ratios, [step] * modes.count)
        return np.asarray(scipy.linalg.block_diag(*blocks))

    values = _template_values(modes, modal, request.amplitude)
    step = longest_step(request, cable_modes.frequencies, float(ratios[0]), transition_matrix)
    return write_template(request, coefficients, beam.elements, step, transition_matrix, **values)


def _template_values(modes: Modes, modal: Sequence[ModalDamping], amplitude: float) -> dict[str, Any]:
    """Return the numbers that the script needs."""
    model = modes.model
    beam, start = model.beam, NODE * model.root
    inertia_force = modes.angular_frequencies[0] ** 2 * amplitude  # in mode 1, per mass and unit shape
    midpoints = (beam.node_points[:-1] + beam.node_points[1:]) / 2
    masses = [
        [
            (model.nodes_of(attachment.point)[0] - start) // NODE,
            attachment.mass,
            attachment.rotary_inertia,
            *inertia_force * modes.along([attachment.point])[0, 0],
        ]
        for attachment in beam.attachments
        if isinstance(attachment, PointMass)
    ]
    projections = [np.zeros((model.size, 0)), *(law.projection(model) for law in modal)]
    modal_rates = [4 * math.pi * np.array(law.ratios) * np.array(law.frequencies) for law in modal]
    return {
        "beam": beam,
        "masses": masses,
        "density": beam.mass_per_length,
        "bending": beam.bending_stiffness,
        "axial": beam.axial_stiffness,
        "curvature": np.array(beam.natural_curvature or np.zeros(beam.elements)),
        "strain": -np.array(beam.prestress or np.zeros(beam.elements)) / beam.elastic_modulus,
        "straight": np.column_stack(
            [np.outer(beam.node_points, beam.axis), np.tile(beam.axis, (beam.elements + 1, 1))]
        ),
        "rest": modes.equilibrium.coordinates[start:].reshape(-1, NODE),
        "pull": inertia_force * modes.along(midpoints)[0],
        "projection": np.hstack(projections)[start:],
        "rates": np.concatenate([np.zeros(0), *modal_rates]),
        "radius": SPECTRAL_RADIUS,
    }


def _generalised_alpha(omega: float, ratio: float, step: float) -> Array:
    """Return the matrix of one step, with after @ x_next = before @ x, for x = (q, v, w) of a mode.

    w is the auxiliary acceleration of the generalised-alpha method.
    """
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
