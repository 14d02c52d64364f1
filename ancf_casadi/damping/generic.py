"""Modal (generic) damping from measured modal parameters, Eqs. (28)-(32).

With mass-normalised modes, Phi^T M Phi = I, Eq. (30), the inverse transformation of diag(2 zeta omega), Eq. (29), is

    C = M Phi diag(2 zeta omega) Phi^T M,                Eq. (32)
    Q = R C R^T e_t,

in which R turns the matrix with the clamp (``law``).  With fewer measured modes than degrees of freedom, Phi has
no inverse; Eq. (32) is then the definition of C and leaves all other modes undamped.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import final

import casadi as cs
import numpy as np

from ancf_casadi.damping.law import DampingLaw, Forces, Parameter, S, check_values, rotate_pairs
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, is_sequence, number, physical, shown
from ancf_casadi.vibration.assembly import EPSILON, Position, Structure
from ancf_casadi.vibration.modes import Modes

FOREIGN = 0.2  # change of a frequency or damping ratio beyond which modes are those of another beam


@final
@dataclass(frozen=True, eq=False)
class ModalDamping(DampingLaw):
    """Modal (generic) damping, C = M Phi diag(2 zeta omega) Phi^T M, Eq. (32).

    Modes beyond those given are undamped.  The matrix turns with the clamp.

    Parameters
    ----------
    modes : Modes
        Natural modes of the beam, at least as many as there are ratios.
    ratios : sequence of float
        Damping ratio of each mode, starting with the first; at least 0 and below 1.
    frequencies : sequence of float, optional
        Measured natural frequencies, Hz; those of ``modes`` if not given.

    Raises
    ------
    InputError
        If a ratio is negative, 1 or more, a frequency is not positive, or the numbers of values do not fit.

    Warns
    -----
    UserWarning
        If the frequencies differ by more than a fifth from those of the modes, or the damping ratios in the beam that
        is damped from those given.

    Examples
    --------
    >>> from ancf_casadi import Beam, ModalDamping, Model, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> modes = natural_modes(Model(beam), count=3)
    >>> law = ModalDamping(modes, ratios=(0.01, 0.003, 0.003))
    >>> [parameter.name for parameter in law.parameters]
    ['ratio1', 'ratio2', 'ratio3']
    >>> law.damping_ratios(modes, [0.01, 0.01, 0.01]).round(4)
    array([0.01 , 0.003, 0.003])
    """

    modes: Modes
    ratios: Sequence[float]
    frequencies: Sequence[float] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Validate, and keep the numbers as tuples."""
        check_instance(self.modes, "modes", Modes)
        for name in ("ratios", "frequencies"):
            values = getattr(self, name)
            if not is_sequence(values) and (name, values) != ("frequencies", None):
                raise InputError(f"must have one value per mode, got {shown(values)}", name)
        object.__setattr__(self, "ratios", tuple(number(zeta, "ratios") for zeta in self.ratios))
        if wrong := [zeta for zeta in self.ratios if not 0.0 <= zeta < 1.0]:
            raise InputError(f"a damping ratio must be at least 0 and below 1, got {wrong[0]:g}", "ratios")
        if not 1 <= len(self.ratios) <= self.modes.count:
            raise InputError(f"has {len(self.ratios)} values for {self.modes.count} modes", "ratios")
        values = self.modes.frequencies[: len(self.ratios)] if self.frequencies is None else self.frequencies
        if len(values) != len(self.ratios):
            raise InputError(f"has {len(values)} values for {len(self.ratios)} ratios", "frequencies")
        frequencies = tuple(physical(frequency, "frequencies") for frequency in values)
        object.__setattr__(self, "frequencies", frequencies)
        computed_frequencies = self.modes.frequencies[: len(frequencies)]
        for k, (measured, computed) in enumerate(zip(frequencies, computed_frequencies.tolist(), strict=True), start=1):
            if abs(measured - computed) > FOREIGN * computed:
                warnings.warn(
                    f"the frequency of mode {k}, {measured:.4g} Hz, is far from the {computed:.4g} Hz of the modes, so "
                    f"its damping ratio in a motion is {measured / computed:.3g} times the one given; match the beam "
                    "first, or correct the frequencies",
                    stacklevel=3,
                )
                break

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The damping ratios."""
        # usual upper bound of an estimated damping ratio
        return tuple(
            Parameter(f"ratio{k}", zeta, "1", f"damping ratio of mode {k}", upper=1.0 - 1e-6)
            for k, zeta in enumerate(self.ratios, start=1)
        )

    def with_parameters(self, values: Sequence[float] | Array) -> ModalDamping:
        """Return the law with other damping ratios."""
        return replace(self, ratios=check_values(self, values))

    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return zero."""
        return 0 * e_t

    def check_nodes(self, model: Model, where: str) -> None:
        """Refuse a model with other nodes than the modes by an ``InputError``."""
        if self.modes.model.beam.elements != model.beam.elements:
            raise InputError("belong to a beam with another number of elements", where)
        if self.modes.model.root != model.root:
            raise InputError(
                "belong to a beam with another support at its beginning, where only one of both has a rigid clamp "
                "without displacement and rotation; make the law from natural_modes of this beam",
                where,
            )

    def projection(self, model: Model) -> Array:
        """Return B = M Phi, so that C = B diag(2 zeta omega) B^T.

        If the modes belong to a beam along another axis, B is turned to the axis of the model.

        Raises
        ------
        InputError
            If the modes belong to a beam with another number of elements, or another kind of support at its beginning.
        """
        self.check_nodes(model, "modes")
        mass = self.modes.model.mass(self.modes.model.properties).sparse()
        self._warn_of_another_beam(model)
        B = cs.DM(mass @ self.modes.shapes[:, : len(self.ratios)])
        return np.asarray(rotate_pairs(B, self.modes.model.beam.axis, model.beam.axis).full())

    def _warn_of_another_beam(self, model: Model) -> None:
        """Warn if the modes are not those of a beam, so that a mode has another damping ratio than given."""
        reference = self.modes.model
        if reference.beam == model.beam:
            return
        count, equilibrium = len(self.ratios), self.modes.equilibrium.coordinates
        columns = cs.DM(np.column_stack([self.modes.shapes[:, :count], equilibrium]))
        turned = rotate_pairs(columns, reference.beam.axis, model.beam.axis).full()
        shapes, stiffness = turned[:, :-1], Structure.of(model).stiffness_product(Position.of(turned[:, -1]))
        masses = np.sum(shapes * (model.mass(model.properties).sparse() @ shapes), axis=0)
        energies = np.array([shape @ stiffness(shape) for shape in map(model.of_free, shapes.T)])
        stiffnesses = energies / np.square(self.modes.angular_frequencies[:count])
        changes = np.abs(1 / np.sqrt(masses * np.maximum(stiffnesses, EPSILON)) - 1)  # of the damping ratios
        k = int(np.argmax(changes))
        if changes[k] > FOREIGN:
            warnings.warn(
                f"the modes of ModalDamping are those of another beam: mode {k + 1} has {masses[k]:.3g} times its "
                f"modal mass and {stiffnesses[k]:.3g} times its modal stiffness in this one, so its damping ratio is "
                "not the one given; make the law from natural_modes of this beam",
                stacklevel=3,
            )

    def modal_coefficients(self, parameters: cs.MX) -> cs.MX:
        """Return 2 zeta omega."""
        return 4 * math.pi * cs.DM(list(self.frequencies or ())) * parameters

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return phi^T C phi / (2 omega) of each mode at any amplitude: for the modes of the law, its ratios."""
        check_instance(modes, "modes", Modes)
        coefficients = 4 * math.pi * np.array(self.ratios) * np.array(self.frequencies)
        squares = (self.projection(modes.model).T @ modes.shapes) ** 2
        return np.asarray(coefficients @ squares / (2 * modes.angular_frequencies))
