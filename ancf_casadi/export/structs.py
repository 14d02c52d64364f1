"""Layout of the JSON document: one msgspec Struct for each of its objects, with the range of every value.

    {"format": "ancf-casadi", "schema": 1,
     "beam": {...}, "strain_measures": {...},      SI units; properties as one value per element; supports and
                                                  attachments as in ``mechanics.lumped``
     "damping": {...} or null,                     the key ``law`` names the law
     "identifications": [...],                     results of fits, and the files that they were made from
     "provenance": {...}}                          time, versions of the programs, and a note

    law          other keys
    rayleigh     alpha (1/s), beta (s), stiffness
    quadratic    eta1 (1/s), eta2 (1/m), flow (m/s)
    friction     eta0 (m/s^2), smoothing_speed (m/s)
    modal        ratios, frequencies (Hz), modes
    sum          laws, which act together

The modes of a modal law are stored with their shapes and their equilibrium, because modes that are computed again
differ in their last digits.  If their beam or strain measures differ from those of the document, they hold their own.

``data_of`` checks data against the layout, and ``schema`` returns the layout as a JSON Schema (draft 2020-12).
Unknown keys are refused, and a key may be left out only if it has a default here.
"""

from __future__ import annotations

import hashlib
import os
import re
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, TypeVar, Union, get_args

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from ancf_casadi.damping import (
    DampingLaw,
    FrictionDamping,
    ProportionalStiffness,
    QuadraticDamping,
    RayleighDamping,
)
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.lumped import ATTACHMENTS, PART_KINDS, SUPPORTS
from ancf_casadi.mechanics.strain import AxialStrain, Curvature
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.files import check, opened
from ancf_casadi.support.inputs import shown

DOCUMENT_FORMAT: Final = "ancf-casadi"
DOCUMENT_VERSION: Final = 1  # of the layout: it changes when the meaning of a key does
LONGEST_MESSAGE = 300

Data = TypeVar("Data")

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Pair = tuple[float, float]
PerElement = Annotated[tuple[Positive, ...], Meta(min_length=2, description="One value per element, from the clamp.")]
Curvatures = Annotated[tuple[float, ...], Meta(description="One value per element; none if the beam is straight.")]
Stresses = Annotated[tuple[float, ...], Meta(min_length=2, description="One value per element, if there is any.")]
Frequencies = Annotated[tuple[Positive, ...], Meta(min_length=1, description="Natural frequencies, Hz.")]
Ratio = Annotated[float, Meta(ge=0.0, lt=1.0)]
Points = Annotated[int, Meta(ge=1, le=9, description="Number of Gauss points.")]
NotEmpty = Annotated[str, Meta(min_length=1)]
Hash = Annotated[str, Meta(pattern="^[0-9a-f]{64}$", max_length=64)]  # $ also matches before a last line feed
Time = Annotated[
    str, Meta(pattern="^[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z$", max_length=20, description="UTC")
]


class DocumentObject(Struct, frozen=True, forbid_unknown_fields=True):
    """An object of the document, with no other keys than its fields."""


def _tagged(name: str, about: str, ranges: dict[str, Any], defaults: dict[str, Any], **tag: str) -> type[Struct]:
    """Return the layout of an object that a key tells apart from others of its place, given the range of each field."""
    own = [(key, kind, defaults[key]) if key in defaults else (key, kind) for key, kind in ranges.items()]
    ((key, value),) = tag.items()
    found = msgspec.defstruct(f"{name}Data", own, bases=(DocumentObject,), namespace={"__doc__": about},
                              module=__name__, frozen=True, tag_field=key, tag=value)  # fmt: skip
    globals()[found.__name__] = found  # where pickle looks for it
    return found


PART_UNITS = {
    "clamp": "m, N m/rad, rad; the stiffness of a rigid clamp is null", "pin": "m",
    "roller": "m; the direction is a unit vector", "guide": "m, rad; the direction is a unit vector",
    "mass": "m, kg, kg m^2", "spring": "m, N/m", "rotational_spring": "m, N m/rad", "dashpot": "m, N s/m",
}  # fmt: skip
SIGNED_FIELDS = {"displacement": Pair, "direction": Pair, "rotation": float}  # the others are not negative
AMOUNTS = {"float": NotNegative, "tuple[float, float]": tuple[NotNegative, NotNegative]}


def _part(kind: str, part: type) -> type[Struct]:
    """Return the layout of a support or attachment: names, types and defaults are those of its class."""
    own = sorted(fields(part), key=lambda one: bool(one.kw_only))
    ranges = {one.name: SIGNED_FIELDS.get(one.name) or AMOUNTS[str(one.type)] for one in own}
    defaults = {one.name: one.default for one in own if one.default is not MISSING}
    if part is Clamp:
        ranges["stiffness"], defaults["stiffness"] = Positive | None, None
    return _tagged(part.__name__, f"Fields of ``{part.__name__}`` ({PART_UNITS[kind]}).", ranges, defaults, kind=kind)


if TYPE_CHECKING:
    SupportData = Struct
    AttachmentData = Struct
    LawData = Struct
else:
    SupportData, AttachmentData = (
        Union[tuple(_part(*one) for one in kinds.items())]  # noqa: UP007
        for kinds in PART_KINDS.values()
    )


class BeamData(DocumentObject, frozen=True):
    """Fields of ``Beam`` (m, kg/m^3, Pa, m/s^2, 1/m); the axis is a unit vector."""

    length: Positive
    width: PerElement
    thickness: PerElement
    density: PerElement
    elastic_modulus: PerElement
    axis: Pair = (0.0, -1.0)
    gravity: Pair = (0.0, -9.81)
    natural_curvature: Curvatures = ()
    prestress: Stresses | UnsetType = UNSET
    supports: tuple[SupportData, ...] = (get_args(SupportData)[0](),)  # a clamp at 0
    attachments: tuple[AttachmentData, ...] = ()


class StrainMeasuresData(DocumentObject, frozen=True):
    """The fields of ``StrainMeasures``."""

    axial: AxialStrain
    curvature: Curvature
    axial_points: Points
    bending_points: Points


class EquilibriumData(DocumentObject, frozen=True):
    """An equilibrium: nodal coordinates (positions in m, slopes), tip force (N) and tip moment (N m)."""

    coordinates: tuple[float, ...]
    tip_force: Pair
    tip_moment: float


class ModesData(DocumentObject, frozen=True):
    """Natural modes of the document's beam, or of a beam of their own; one list of nodal coordinates per mode."""

    frequencies: Frequencies
    shapes: Annotated[tuple[tuple[float, ...], ...], Meta(min_length=1)]
    equilibrium: EquilibriumData
    beam: BeamData | UnsetType = UNSET
    strain_measures: StrainMeasuresData | UnsetType = UNSET

    def __post_init__(self) -> None:
        """Refuse a beam without strain measures, and strain measures without a beam."""
        if (self.beam is UNSET) != (self.strain_measures is UNSET):
            raise ValueError("must have both of beam and strain_measures, or neither")


COEFFICIENT_LAWS: dict[type[Struct], type[DampingLaw]] = {  # whose fields are coefficients only
    _tagged("Rayleigh", "Rayleigh (proportional) damping, alpha M + beta K; alpha in 1/s, beta in s.",
            {"alpha": NotNegative, "beta": NotNegative, "stiffness": ProportionalStiffness}, {},
            law="rayleigh"): RayleighDamping,
    _tagged("Quadratic", "Air drag, linear (eta1, 1/s) and quadratic (eta2, 1/m) in the velocity; flow of air, m/s.",
            {"eta1": NotNegative, "eta2": NotNegative, "flow": Pair}, {"flow": (0.0, 0.0)},
            law="quadratic"): QuadraticDamping,
    _tagged("Friction", "Dry friction along the beam; eta0 in m/s^2, smoothing_speed in m/s.",
            {"eta0": NotNegative, "smoothing_speed": Positive}, {}, law="friction"): FrictionDamping,
}  # fmt: skip


class ModalData(DocumentObject, frozen=True, tag_field="law", tag="modal"):
    """Modal (generic) damping, M Phi diag(2 zeta omega) Phi^T M; one ratio and one measured frequency per mode."""

    ratios: Annotated[tuple[Ratio, ...], Meta(min_length=1)]
    frequencies: Frequencies
    modes: Annotated[
        ModesData,
        Meta(extra_json_schema={"dependentRequired": {"beam": ["strain_measures"], "strain_measures": ["beam"]}}),
    ]


class SumData(DocumentObject, frozen=True, tag_field="law", tag="sum"):
    """Laws that act together."""

    laws: Annotated[tuple[LawData, ...], Meta(min_length=1)]


if not TYPE_CHECKING:
    LawData = Union[(*COEFFICIENT_LAWS, ModalData, SumData)]

TAGS = {  # allowed values of the keys that hold a name
    "law": [kind.__struct_config__.tag for kind in get_args(LawData)],
    "supports.kind": [*SUPPORTS],
    "attachments.kind": [*ATTACHMENTS],
    "stiffness": get_args(ProportionalStiffness),
    "axial": get_args(AxialStrain),
    "curvature": get_args(Curvature),
}


class DataFile(DocumentObject, frozen=True):
    """Name and hash of a file of measurements.

    Parameters
    ----------
    name : str
        Name of the file, without folders.
    sha256 : str
        SHA-256 of the content, 64 hexadecimal digits.

    Raises
    ------
    InputError
        If the name is empty, or the hash does not have 64 hexadecimal digits.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi.export import DataFile
    >>> _ = Path("decay.csv").write_text("0.0,1.0")
    >>> file = DataFile.of("decay.csv")
    >>> file.name, file.sha256[:8]
    ('decay.csv', 'f6478e63')
    """

    name: NotEmpty
    sha256: Hash

    def __post_init__(self) -> None:
        """Validate."""
        for key, kind in (("name", NotEmpty), ("sha256", Hash)):
            check(data_of(getattr(self, key), kind, key), key)

    @classmethod
    def of(cls, path: str | Path) -> DataFile:
        """Return name and hash of a file; one that cannot be read raises an ``InputError``."""
        digest = hashlib.sha256()
        with opened(path) as file:
            while chunk := file.read(2**20):  # bytes
                digest.update(chunk)
        name = os.fsencode(Path(path).name).decode(errors="replace")
        return cls(name, digest.hexdigest())


class IdentificationData(DocumentObject, frozen=True):
    """The result of a fit: kind, estimates, intervals, covariance, warnings; null is unknown or not finite."""

    result: dict[str, Any]
    data: tuple[DataFile, ...]


class ProvenanceData(DocumentObject, frozen=True):
    """Time of writing (UTC), versions of the programs, and a note."""

    written: Time
    versions: dict[str, str]
    note: str


class DocumentData(DocumentObject, frozen=True):
    """A beam with its damping law and its identifications; SI units, and no key twice in an object."""

    format: Literal["ancf-casadi"]
    schema: Literal[1]
    beam: BeamData
    strain_measures: StrainMeasuresData
    damping: LawData | None
    identifications: tuple[IdentificationData, ...]
    provenance: ProvenanceData


def read(data: dict[str, Any]) -> DocumentData:
    """Return plain data as a document; refuse another layout by its place, such as ``$.damping.laws[0].alpha``."""
    if data.get("format") != DOCUMENT_FORMAT:
        raise InputError(f"must be {DOCUMENT_FORMAT!r}: the file is not a document of this toolkit", "$.format")
    version = data.get("schema")
    if type(version) is not int or version != DOCUMENT_VERSION:
        message = (
            f"must be {DOCUMENT_VERSION}, got {shown(version)}; a document of a later version needs a later release"
        )
        raise InputError(message, "$.schema")
    return data_of(data, DocumentData, "$")


def data_of(source: Any, kind: type[Data], where: str = "") -> Data:
    """Return plain data, or the attributes of an object, as data of the layout; refuse what does not fit it."""
    try:
        return msgspec.convert(source, kind, from_attributes=True)
    except msgspec.ValidationError as error:
        raise _refusal(str(error), where) from None


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a document.

    Examples
    --------
    >>> from ancf_casadi.export import schema
    >>> schema()["$schema"]
    'https://json-schema.org/draft/2020-12/schema'
    """
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:{DOCUMENT_FORMAT}:document:{DOCUMENT_VERSION}",
    }
    found = msgspec.json.schema(DocumentData)
    for part in found["$defs"].values():
        part["description"] = part["description"].partition("\n")[0]
    return head | found


def _refusal(message: str, where: str) -> InputError:
    """Return the error for a message of msgspec: one line of limited length, with the names that a key may hold."""
    found = re.fullmatch(r"(.*?)(?: - at (?:`key` in )?`\$([^`]*)`)?", message, re.DOTALL)
    reason, inner = found.groups("") if found else (message, "")
    text = " ".join(reason.split())
    text = text if len(text) <= LONGEST_MESSAGE else f"{text[: LONGEST_MESSAGE // 2]}..."
    path = re.sub(r"\[[^]]*\]", "", inner)
    known = next((names for key, names in TAGS.items() if f".{path}".endswith(f".{key}")), ())
    advice = f"; must be one of {', '.join(known)}" if known else ""
    return InputError(f"{text[0].lower()}{text[1:]}{advice}", f"{where}{inner}" if where else inner.removeprefix("."))
