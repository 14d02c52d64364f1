"""Tables of TOML files as classes with types and ranges."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Annotated, Any, TypeVar

from msgspec import Meta
from msgspec import inspect as types

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import (
    check_keys,
    choice,
    flag,
    is_sequence,
    located,
    number,
    physical,
    shown,
    vector,
    whole,
)
from problems.spec.help import UNLISTED

Made = TypeVar("Made")

Positive = Annotated[float, Meta(gt=0.0)]
Hooks = Mapping[type, Callable[[Any, str], Any]]  # class of a field -> function of the value and its place


def read(value: Any, kind: type[Made], where: str, hooks: Hooks = MappingProxyType({})) -> Made:
    """Return a value, as ``tomllib`` returns it, as a declared type; messages call its place ``where``.

    The fields of a class are the keys of a table, with ranges and descriptions by ``msgspec.Meta``.  The hooks make the
    instances of some classes of a value and its place, such as the law of a name.
    """
    found: Made = _read(value, types.type_info(kind), where, hooks)
    return found


def _read(value: Any, kind: types.Type, where: str, hooks: Hooks) -> Any:
    match kind:
        case types.Metadata():
            return _read(value, kind.type, where, hooks)
        case types.StructType() | types.DataclassType() if kind.cls in hooks:
            return hooks[kind.cls](value, where)
        case types.StructType() | types.DataclassType():
            fields = {field.encode_name: field for field in _fields(kind)}
            required = {key for key, field in fields.items() if field.required}
            check_keys(value, required, fields.keys() - required, where)
            given = {key: _read(own, fields[key].type, f"{where}: {key}", hooks) for key, own in value.items()}
            with located(where):
                return kind.cls(**{fields[key].name: own for key, own in given.items()})
        case types.DictType():
            if not isinstance(value, dict):
                raise InputError(f"must be a table, got {shown(value)}", where)
            return {key: _read(own, kind.value_type, f"{where}: {key}", hooks) for key, own in value.items()}
        case types.FloatType():
            return _real(value, kind, where)
        case types.IntType():
            return whole(value, where, kind.ge or 0, kind.le)
        case types.BoolType():
            return flag(value, where)
        case types.LiteralType():
            return choice(value, [str(name) for name in kind.values], where)
        case types.StrType():
            if not isinstance(value, str):
                raise InputError(f"must be a text, got {shown(value)}", where)
        case types.TupleType() if len(kind.item_types) == 2:
            pair = zip(vector(value, where), kind.item_types, strict=True)
            return tuple(_read(own, item, where, hooks) for own, item in pair)
        case types.VarTupleType():
            return _list(value, kind, where, hooks)
        case types.UnionType():
            known = [own for own in kind.types if not isinstance(own, types.NoneType)]
            known.sort(key=lambda own: isinstance(own, types.VarTupleType) != is_sequence(value))  # lists for lists
            return _read(value, known[0], where, hooks)
    return value


def _fields(kind: types.StructType | types.DataclassType) -> list[types.Field]:
    """Return the fields that are keys of a table."""
    return [field for field in kind.fields if getattr(field.type, "extra", None) != UNLISTED.extra]


def _real(value: Any, kind: types.FloatType, where: str) -> float:
    result = number(value, where) if kind.gt != 0 else physical(value, where)
    if kind.ge is not None and result < kind.ge:
        raise InputError(
            "must not be negative" if kind.ge == 0 else f"must be at least {kind.ge:g}, got {result:g}", where
        )
    if kind.le is not None and result > kind.le:
        raise InputError(f"must be at most {kind.le:g}, got {result:g}", where)
    if kind.lt is not None and result >= kind.lt:
        raise InputError(f"must be below {kind.lt:g}, got {result:g}", where)
    return result


def _list(value: Any, kind: types.VarTupleType, where: str, hooks: Hooks) -> tuple[Any, ...]:
    item = kind.item_type
    tables = isinstance(item, types.StructType | types.DataclassType) and item.cls not in hooks
    texts = "texts" if isinstance(item, types.StrType) else "names"
    what = "tables" if tables else "numbers" if isinstance(item, types.FloatType | types.Metadata) else texts
    least, most = kind.min_length or 0, kind.max_length
    if not is_sequence(value) or len(value) < least or (most is not None and len(value) > most):
        size = f"{least} to {most} {what}" if most else f"{least} or more {what}" if least else what
        raise InputError(f"must be a list of {size}, got {shown(value)}", where)
    return tuple(_read(own, item, f"{where}: {k}" if tables else where, hooks) for k, own in enumerate(value, start=1))
