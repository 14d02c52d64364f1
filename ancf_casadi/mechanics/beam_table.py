"""Supports and attachments as tables of a document, told apart by their key ``kind``.

    kind                  other keys
    clamp                 point, stiffness, displacement, rotation
    pin                   point, displacement
    roller                point, direction, displacement
    guide                 point, direction, displacement, rotation
    mass                  point, mass, rotary_inertia
    spring                point, stiffness
    rotational_spring     point, stiffness
    dashpot               point, coefficient

The keys are the fields of the classes, in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.attachments import Attachment, Dashpot, PointMass, RotationalSpring, Spring
from ancf_casadi.mechanics.supports import Clamp, Guide, Pin, Roller, Support
from ancf_casadi.support.inputs import check_keys, is_one_of, is_sequence, located, shown

SUPPORTS: Mapping[str, type[Support]] = {"clamp": Clamp, "pin": Pin, "roller": Roller, "guide": Guide}
ATTACHMENTS: Mapping[str, type[Attachment]] = {
    "mass": PointMass,
    "spring": Spring,
    "rotational_spring": RotationalSpring,
    "dashpot": Dashpot,
}
PART_KINDS: Mapping[str, Mapping[str, type]] = {"supports": SUPPORTS, "attachments": ATTACHMENTS}


def with_parts(table: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    """Return the keys of a table with its supports and attachments, if it has any, in place of their tables."""
    found = dict(table)
    for name in PART_KINDS.keys() & table.keys():
        place, given = f"{where}: {name}".removeprefix(": "), table[name]
        if not is_sequence(given):
            raise InputError(f"must be a list of tables, got {shown(given)}", place)
        found[name] = tuple(_part(one, PART_KINDS[name], f"{place}: {k}") for k, one in enumerate(given, start=1))
    return found


def _part(table: Any, kinds: Mapping[str, type], where: str) -> Any:
    """Return the support or attachment of a table."""
    kind = table.get("kind") if isinstance(table, dict) else None
    if not is_one_of(kind, [*kinds]):
        raise InputError(f"kind must be one of {', '.join(kinds)}, got {shown(kind)}", where)
    own = {key: value for key, value in table.items() if key != "kind"}
    known = fields(kinds[str(kind)])
    required = {field.name for field in known if field.default is MISSING}
    check_keys(own, required, {field.name for field in known} - required, where)
    with located(where):
        return kinds[str(kind)](**own)


def table_of(part: Support | Attachment) -> dict[str, Any]:
    """Return a support or attachment as a table."""
    kinds = {kind: name for own in PART_KINDS.values() for name, kind in own.items()}
    return {"kind": kinds[type(part)], **{field.name: getattr(part, field.name) for field in fields(part)}}
