"""A damping law as data: a table ``[[damping]]`` of a TOML file, and the object ``damping`` of a JSON document.

A modal law of a document holds the shapes and the equilibrium of its modes, because modes that are computed again
differ in their last digits, and their beam and strain measures if these differ from those of the document.  In a TOML
file it takes the natural modes of the beam.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from functools import reduce
from typing import Annotated, Any, ClassVar

import numpy as np
from msgspec import UNSET, Meta, UnsetType

from ancf_casadi.damping.friction import FrictionDamping
from ancf_casadi.damping.generic import ModalDamping
from ancf_casadi.damping.law import DampingLaw, SumOfLaws
from ancf_casadi.damping.proportional import ProportionalStiffness, RayleighDamping
from ancf_casadi.damping.quadratic import QuadraticDamping
from ancf_casadi.damping.viscoelastic import ViscoelasticDamping
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import BeamSpec, StrainMeasuresSpec, model_from
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.specs import NotNegative, Pair, Positive, Spec, convert, value_place
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes, natural_modes

Ratio = Annotated[float, Meta(ge=0.0, lt=1.0)]
Frequencies = tuple[Positive, ...]


class EquilibriumSpec(Spec, frozen=True):
    """An equilibrium: nodal coordinates (positions in m, slopes), tip force (N) and tip moment (N m)."""

    coordinates: tuple[float, ...]
    tip_force: Pair
    tip_moment: float


class ModesSpec(Spec, frozen=True):
    """Natural modes of the document's beam, or of a beam of their own; one list of nodal coordinates per mode."""

    frequencies: Annotated[Frequencies, Meta(min_length=1, description="Hz")]
    shapes: Annotated[tuple[tuple[float, ...], ...], Meta(min_length=1)]
    equilibrium: EquilibriumSpec
    beam: BeamSpec | UnsetType = UNSET
    strain_measures: StrainMeasuresSpec | UnsetType = UNSET

    def __post_init__(self) -> None:
        """Refuse a beam without strain measures, and strain measures without a beam."""
        if (self.beam is UNSET) != (self.strain_measures is UNSET):
            raise ValueError("must have both of beam and strain_measures, or neither")

    @classmethod
    def of(cls, modes: Modes, model: Model) -> ModesSpec:
        """Return the specification of modes, for a document that holds a model."""
        equilibrium = modes.equilibrium
        if equilibrium.loads:
            raise InputError(
                "refer to an equilibrium under loads away from the tip, which a document cannot hold", "modes"
            )
        beam_fields: dict[str, Any] = {}
        if modes.model != model:
            measures = convert(modes.model.measures, StrainMeasuresSpec)
            beam_fields = {"beam": BeamSpec.of(modes.model.beam), "strain_measures": measures}
        return cls(
            frequencies=tuple(modes.frequencies.tolist()),
            shapes=tuple(map(tuple, modes.shapes.T.tolist())),
            equilibrium=EquilibriumSpec(
                coordinates=tuple(equilibrium.coordinates.tolist()),
                tip_force=equilibrium.tip_force,
                tip_moment=equilibrium.tip_moment,
            ),
            **beam_fields,
        )

    def modes(self, model: Model, where: str) -> Modes:
        """Return the modes, at a place of a document that holds a model."""
        if self.beam is not UNSET and self.strain_measures is not UNSET:
            model = model_from(self.beam, self.strain_measures, where)
        if len(self.shapes) != len(self.frequencies):
            message = f"has {len(self.shapes)} shapes for {len(self.frequencies)} frequencies"
            raise InputError(message, value_place(where, ["shapes"]))
        shapes = [_coordinates(shape, model, value_place(where, ["shapes", k])) for k, shape in enumerate(self.shapes)]
        spec = self.equilibrium
        coordinates = _coordinates(spec.coordinates, model, value_place(where, ["equilibrium", "coordinates"]))
        equilibrium = Equilibrium(model, coordinates, spec.tip_force, spec.tip_moment)
        return Modes(equilibrium, np.array(self.frequencies), np.ascontiguousarray(np.array(shapes).T))


class DampingSpec(Spec, frozen=True, tag_field="law"):
    """A damping law, which a key ``law`` names."""

    described: ClassVar[type[DampingLaw]]

    def law(self, model: Model, where: str) -> DampingLaw:
        """Return the law on a beam; messages name the place."""
        with error_prefix(where):
            return self.described(**self.set_fields())

    def check(self, model: Model, where: str) -> None:
        """Refuse values that make no law on a beam, without solving for its modes."""
        self.law(model, where)


class RayleighSpec(DampingSpec, frozen=True, tag="rayleigh"):
    """Rayleigh (proportional) damping, alpha M + beta K."""

    described = RayleighDamping

    alpha: Annotated[float, Meta(ge=0.0, description="1/s")] = 0.0
    beta: Annotated[float, Meta(ge=0.0, description="s")] = 0.0
    stiffness: ProportionalStiffness = "strain-rate"


class QuadraticSpec(DampingSpec, frozen=True, tag="quadratic"):
    """Air drag, linear and quadratic in the velocity, by its coefficients or by the drag coefficient."""

    described = QuadraticDamping

    eta1: Annotated[float, Meta(ge=0.0, description="1/s")] = 0.0
    eta2: Annotated[float, Meta(ge=0.0, description="1/m")] = 0.0
    flow: Annotated[Pair, Meta(description="of the air along x and y, m/s")] = (0.0, 0.0)
    drag_coefficient: Annotated[NotNegative | UnsetType, Meta(description="instead of eta1 and eta2")] = UNSET
    air_density: Annotated[Positive | UnsetType, Meta(description="kg/m^3, beside drag_coefficient")] = UNSET

    def law(self, model: Model, where: str) -> DampingLaw:
        """Return the law on a beam, whose width, thickness and density a drag coefficient needs."""
        if self.drag_coefficient is UNSET and self.air_density is UNSET:
            return super().law(model, where)
        if self.drag_coefficient is UNSET or self.air_density is UNSET or self.eta1 or self.eta2:
            raise InputError("give either eta1 and eta2, or both of drag_coefficient and air_density", where)
        with error_prefix(where):
            return QuadraticDamping.from_drag(self.drag_coefficient, self.air_density, model.beam, flow=self.flow)


class FrictionSpec(DampingSpec, frozen=True, tag="friction"):
    """Dry friction along the beam."""

    described = FrictionDamping

    eta0: Annotated[float, Meta(ge=0.0, description="m/s^2")] = 0.0
    smoothing_speed: Annotated[float, Meta(gt=0.0, description="m/s")] = 1e-3


class ViscoelasticSpec(DampingSpec, frozen=True, tag="viscoelastic"):
    """A material that relaxes: Maxwell branches in parallel with the elastic beam."""

    described = ViscoelasticDamping

    ratios: Annotated[tuple[Positive, ...], Meta(min_length=1, description="moduli relative to that of the beam")]
    times: Annotated[tuple[Positive, ...], Meta(min_length=1, description="relaxation times, s")]

    def __post_init__(self) -> None:
        """Refuse a number of times other than that of the ratios."""
        if len(self.times) != len(self.ratios):
            raise ValueError(f"times: has {len(self.times)} values for {len(self.ratios)} ratios")


class ModalSpec(DampingSpec, frozen=True, tag="modal"):
    """Modal (generic) damping, M Phi diag(2 zeta omega) Phi^T M."""

    described = ModalDamping

    ratios: Annotated[tuple[Ratio, ...], Meta(min_length=1, description="of each mode from the first")]
    frequencies: Annotated[Frequencies, Meta(description="measured ones, Hz")] = ()
    modes: Annotated[
        ModesSpec | UnsetType,
        Meta(
            description="of a document",
            extra_json_schema={"dependentRequired": {"beam": ["strain_measures"], "strain_measures": ["beam"]}},
        ),
    ] = UNSET

    def __post_init__(self) -> None:
        """Refuse frequencies that are not one per ratio."""
        if self.frequencies and len(self.frequencies) != len(self.ratios):
            raise ValueError(f"frequencies: has {len(self.frequencies)} values for {len(self.ratios)} ratios")

    def law(self, model: Model, where: str) -> DampingLaw:
        """Return the law on a beam, with the modes that the law holds, or else those of the beam."""
        if self.modes is UNSET:
            modes = natural_modes(model, count=min(len(self.ratios), model.freedoms))
        else:
            modes = self.modes.modes(model, value_place(where, ["modes"]))
        with error_prefix(where):
            return ModalDamping(modes, self.ratios, frequencies=self.frequencies or None)

    def check(self, model: Model, where: str) -> None:
        """Refuse more damping ratios than the beam has modes."""
        if len(self.ratios) > model.freedoms:
            message = f"has {len(self.ratios)} values for {model.freedoms} modes"
            raise InputError(message, value_place(where, ["ratios"]))


class SumSpec(DampingSpec, frozen=True, tag="sum"):
    """Laws that act together."""

    described = SumOfLaws

    laws: Annotated[tuple[LawSpec, ...], Meta(min_length=1)]

    def law(self, model: Model, where: str) -> DampingLaw:
        """Return the sum of the laws on a beam."""
        places = [value_place(where, ["laws", k]) for k in range(len(self.laws))]
        return SumOfLaws(tuple(spec.law(model, place) for spec, place in zip(self.laws, places, strict=True)))

    def check(self, model: Model, where: str) -> None:
        """Check each of the laws."""
        for k, spec in enumerate(self.laws):
            spec.check(model, value_place(where, ["laws", k]))


LawSpec = RayleighSpec | QuadraticSpec | FrictionSpec | ViscoelasticSpec | ModalSpec | SumSpec


def law_spec(law: DampingLaw, model: Model) -> LawSpec:
    """Return the specification of a law, for a document that holds a model; refuse a law that has none."""
    if isinstance(law, ModalDamping):
        return ModalSpec(
            ratios=tuple(law.ratios), frequencies=tuple(law.frequencies or ()), modes=ModesSpec.of(law.modes, model)
        )
    if isinstance(law, SumOfLaws):
        return SumSpec(laws=tuple(law_spec(term, model) for term in law.laws))
    simple = (RayleighSpec, QuadraticSpec, FrictionSpec, ViscoelasticSpec)
    kinds: dict[type, Any] = {kind.described: kind for kind in simple}
    if type(law) in kinds:
        spec: LawSpec = convert(law, kinds[type(law)])
        return spec
    names = ", ".join(law_class.__name__ for law_class in (*kinds, ModalDamping))
    message = f"a {type(law).__name__} cannot be written to a document; only {names} and their sums can"
    raise InputError(message, "damping")


def sum_laws(laws: Sequence[DampingLaw]) -> DampingLaw | None:
    """Return the sum of laws; None if there are none."""
    return reduce(operator.add, laws) if laws else None


def _coordinates(values: tuple[float, ...], model: Model, where: str) -> Array:
    if len(values) != model.size:
        raise InputError(f"has {len(values)} values for {model.size} coordinates", where)
    return np.array(values)
