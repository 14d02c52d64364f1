"""Specifications: data with types, ranges, units and descriptions, declared once as a msgspec Struct.

A subclass of ``Spec`` describes both a table of a TOML file and an object of a JSON document.  Its fields are the keys;
``msgspec.Meta`` holds their ranges and descriptions.  A dataclass of the toolkit can also describe a table.
``convert`` converts plain data, and reports an error in one line with its place, such as

    study.toml: [beam]: supports: 2: stiffness: must be positive, got -1
    $.beam.supports[1].stiffness: must be positive, got -1

where a place that begins with ``$`` is a path in a JSON document.
"""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache
from typing import Annotated, Any, TypeVar, cast, overload

import msgspec
from msgspec import UNSET, Meta, Struct
from msgspec import inspect as types
from msgspec.structs import asdict

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import check_keys, error_prefix, shown

SpecType = TypeVar("SpecType")

Positive = Annotated[float, Meta(gt=0.0, le=1e30)]  # as ``physical``: its powers are finite
PositiveOrInfinite = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Pair = tuple[float, float]
UNLISTED = Meta(extra={"hidden": True})  # of a field that is not a key of a table

NOUNS = {"float": "a number", "int": "a whole number", "str": "a text", "bool": "true or false", "array": "a list",
         "object": "a table", "null": "null"}  # fmt: skip


class FieldError(InputError, ValueError):
    """An error of a specification that checks itself, to which msgspec adds its path in a document."""


class Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """A table whose only keys are its fields."""

    def set_fields(self) -> dict[str, Any]:
        """Return the fields that are set."""
        return {name: value for name, value in asdict(self).items() if value is not UNSET}


@overload
def convert(source: Any, kind: type[SpecType], where: str = "") -> SpecType: ...
@overload
def convert(source: Any, kind: Any, where: str = "") -> Any: ...
def convert(source: Any, kind: Any, where: str = "") -> Any:
    """Convert plain data, or the attributes of an object, to a type; an error names the place."""
    if is_dataclass(kind) and isinstance(source, Mapping):
        check_keys(source, set(), table_keys(kind), where)  # a Struct refuses unknown keys by itself
    try:
        with error_prefix(where):
            return msgspec.convert(source, kind, from_attributes=True)
    except msgspec.ValidationError as error:
        reason, _, path = str(error).partition(" - at ")
        steps: list[str | int] = []
        value = source
        declared: types.Type | None = _select_by_tag(types.type_info(kind), source)
        for name, number, any_key in re.findall(r"\.([^.\[\]`]+)|\[(\d+)\]|\[(\.\.\.)\]", path):
            step = _refused_key(source, kind, steps, value, str(error)) if any_key else name or int(number)
            steps.append(step)
            value = _item(value, step)
            declared = _declaration(declared, step, value)
        message = "has a key that is no text" if path.startswith("`key`") else _plain_reason(reason, value, declared)
        raise InputError(message, value_place(where, steps)) from None


def table_keys(kind: Any) -> set[str]:
    """Return the keys of a table that a class declares."""
    return {field.encode_name for field in listed_fields(kind)}


@cache
def listed_fields(kind: type) -> tuple[types.Field, ...]:
    """Return the fields of a class that are keys of a table."""
    info = types.type_info(kind)
    assert isinstance(info, types.StructType | types.DataclassType)
    return tuple(field for field in info.fields if getattr(field.type, "extra", None) != UNLISTED.extra)


def value_place(where: str, steps: Sequence[str | int]) -> str:
    """Return the place of a value: a path in a document, ``$.laws[0]``, or else names and numbers from 1."""
    if where.startswith("$"):
        return where + "".join(f".{step}" if isinstance(step, str) else f"[{step}]" for step in steps)
    names = [step if isinstance(step, str) else str(step + 1) for step in steps]
    return ": ".join([*([where] if where else []), *names])


def plain(kind: types.Type) -> types.Type:
    """Return a declared type without its description."""
    return plain(kind.type) if isinstance(kind, types.Metadata) else kind


def alternatives(kind: types.Type) -> tuple[types.Type, ...]:
    """Return the types that a value may have."""
    kind = plain(kind)
    return tuple(map(plain, kind.types)) if isinstance(kind, types.UnionType) else (kind,)


def _item(value: Any, step: str | int) -> Any:
    """Return the value at a step into plain data or an object; None if there is none."""
    if isinstance(value, Mapping):
        return value.get(step)
    if isinstance(step, str):
        return getattr(value, step, None)
    return value[step] if isinstance(value, Sequence) and step < len(value) else None


def _refused_key(source: Any, kind: Any, steps: Sequence[str | int], table: Mapping[str, Any], message: str) -> str:
    """Return the first key, of the table at steps into plain data, whose value alone causes the message."""
    for key, item in table.items():
        reduced = copy.deepcopy(source)
        place = reduced
        for step in steps:
            place = _item(place, step)
        place.clear()
        place[key] = item
        try:
            msgspec.convert(reduced, kind, from_attributes=True)
        except msgspec.ValidationError as error:
            if str(error) == message:
                return key
    return "..."  # the values are refused together only


def _declaration(declared: types.Type | None, step: str | int, value: Any) -> types.Type | None:
    """Return the declared type at a step into a type, or None if it is undeclared."""
    for kind in alternatives(declared) if declared else ():
        if isinstance(kind, types.VarTupleType) and isinstance(step, int):
            return _select_by_tag(kind.item_type, value)
        if isinstance(kind, types.TupleType) and isinstance(step, int):
            return kind.item_types[step]
        if isinstance(kind, types.StructType | types.DataclassType):
            if step == getattr(kind, "tag_field", None):
                return declared
            if field_types := [field.type for field in kind.fields if field.encode_name == step]:
                return _select_by_tag(field_types[0], value)
        if isinstance(kind, types.DictType) and isinstance(step, str):
            return _select_by_tag(kind.value_type, value)
    return None


def _select_by_tag(declared: types.Type, value: Any) -> types.Type:
    """Return the alternative that the tag of a table names, or else the declared type."""
    for kind in alternatives(declared):
        if isinstance(kind, types.StructType) and kind.tag and _item(value, cast(str, kind.tag_field)) == kind.tag:
            return kind
    return declared


def _plain_reason(reason: str, value: Any, declared: types.Type | None) -> str:
    """Return the message of msgspec in the words of the checks of this package."""
    kinds = [kind for kind in (alternatives(declared) if declared else ()) if not isinstance(kind, types.NoneType)]
    structs = [kind for kind in kinds if isinstance(kind, types.StructType)]
    if match := re.fullmatch(r"Object missing required field `(.*)`", reason):
        tags = ", ".join(str(kind.tag) for kind in structs if kind.tag_field == match[1])
        return f"the key '{match[1]}' is missing" + (f"; it is one of {tags}" if tags else "")
    if match := re.fullmatch(r"Object contains unknown field `(.*)`", reason):
        keys = sorted(field.encode_name for field in structs[0].fields) if structs else []
        return f"unknown key {shown(match[1])}; known are {', '.join(keys)}"
    if reason.startswith("Invalid"):
        names = [str(kind.tag) for kind in structs if kind.tag]
        names += [str(name) for kind in kinds if isinstance(kind, types.LiteralType) for name in kind.values]
        return f"must be one of {', '.join(names)}, got {shown(value)}"
    if isinstance(value, float) and not math.isfinite(value):
        return f"must be a finite number, got {value:g}"
    if re.match(r"Expected `(float|int)`", reason):
        return f"must {_number_range(kinds, value)}, got {shown(value)}"
    if reason.startswith("Expected `array`") and any(isinstance(kind, types.TupleType) for kind in kinds):
        return f"must be a pair of numbers (x, y), got {shown(value)}"
    for kind in kinds:
        if isinstance(kind, types.VarTupleType) and reason.startswith("Expected `array` of length"):
            upper = "or more" if kind.max_length is None else f"to {kind.max_length}"
            return f"must be a list of {kind.min_length or 0} {upper}, got {shown(value)}"
    if match := re.fullmatch(r"Expected `([^`]*)`, got `[^`]*`", reason):
        nouns = [NOUNS.get(name, name) for name in match[1].split(" | ") if name != "null"]
        return f"must be {' or '.join(nouns)}, got {shown(value)}"
    if reason.startswith("Expected"):
        return f"{reason[0].lower()}{reason[1:]}, got {shown(value)}"
    return reason  # of a check by the class itself


def _number_range(kinds: Sequence[types.Type], value: Any) -> str:
    """Return the range of a declared number that a value violates, as a phrase after "must"."""
    for kind in kinds:
        if isinstance(kind, types.IntType):
            return f"be a whole number, {kind.ge or 0} " + ("or more" if kind.le is None else f"to {kind.le}")
        if isinstance(kind, types.FloatType) and isinstance(value, int | float) and not isinstance(value, bool):
            if kind.gt == 0.0 and value <= 0.0:
                return "be positive"
            if kind.ge == 0.0 and value < 0.0:
                return "not be negative"
            limits = (("above", kind.gt), ("at least", kind.ge), ("below", kind.lt), ("at most", kind.le))
            return "be " + " and ".join(f"{word} {limit:g}" for word, limit in limits if limit is not None)
    return "be a number"
