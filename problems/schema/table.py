"""One declaration per key: tables of TOML files as arguments of a function, or as a class with types and ranges."""

from __future__ import annotations

import hashlib
import inspect
import textwrap
import typing
from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, TypeVar

from msgspec import Meta
from msgspec import inspect as types

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import opened, read_toml
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
from ancf_casadi.support.specs import plain

Made = TypeVar("Made")

Positive = Annotated[float, Meta(gt=0.0)]
Hooks = Mapping[type, Callable[[Any, str], Any]]  # class of a field -> function of the value and its place
UNLISTED = Meta(extra={"hidden": True})  # of a field that no table gives
FILE_TABLES = set(
    "beam match damping base load release simulation response markers records frequencies predictions fit study parts"
    " laws decays statics curves plan candidates".split()
)  # fmt: skip
NAMING = ("file", "document")  # keys whose value is the name of a file


def made(table: Any, maker: Callable[..., Made], where: str, keys: Set[str] | None = None, **given: Any) -> Made:
    """Return what a function or a class, which checks its arguments, makes of a table.

    Its parameters are the keys of the table, or only ``keys`` of them; those without a default are required, and those
    in ``given`` are no keys.  Messages call the place of the table ``where``.
    """
    parameters = inspect.signature(maker).parameters.values()
    known = [one for one in parameters if one.name not in given and (keys is None or one.name in keys)]
    required = {one.name for one in known if one.default is one.empty}
    check_keys(table, required, {one.name for one in known} - required, where)
    with located(where):
        return maker(**table, **given)


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


def told(head: str, text: str, *declared: type, indent: int = 16, base: type | None = None) -> str:
    """Return the help on a table: its head, and beside it a text in which each {} stands for the keys of a class."""
    full = f"  {head} ".ljust(indent) + text.format(*(", ".join(keys_of(kind, base)) for kind in declared))
    return (
        textwrap.fill(full, 80, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False) + "\n"
    )


def told_kinds(head: str, kinds: Any) -> str:
    """Return the help on a table of several kinds, which a key tells apart."""
    infos: list[Any] = [plain(types.type_info(kind)) for kind in typing.get_args(kinds)]
    lines = [f'{info.tag_field} = "{info.tag}": {", ".join(keys_of(info.cls))}' for info in infos]
    folded = [textwrap.fill(line, 64, break_long_words=False, break_on_hyphens=False) for line in lines]
    return f"  {head}\n" + textwrap.indent("\n".join(folded), " " * 16) + "\n"


def keys_of(kind: type, base: type | None = None) -> list[str]:
    """Return the keys that a class declares beyond its base, each with its description."""
    known = keys_of(base) if base else []
    info = types.type_info(kind)
    assert isinstance(info, types.StructType | types.DataclassType)
    return [key for field in _fields(info) if (key := _told(field)) not in known]


def _told(field: types.Field) -> str:
    """Return a key with its description, or the names that it may have."""
    own = field.type
    note = (own.extra_json_schema or {}).get("description", "") if isinstance(own, types.Metadata) else ""
    plain = own.type if isinstance(own, types.Metadata) else own
    if isinstance(plain, types.LiteralType):
        note = note or " or ".join(f'"{value}"' for value in plain.values)
    elif isinstance(plain, types.BoolType):
        note = f"true or false{note and f': {note}'}"
    if note[:1] in ("[", "{"):
        return f"{field.encode_name} = {note}"
    return f"{field.encode_name} ({note})" if note else field.encode_name


@dataclass(frozen=True)
class StudyFile:
    """The tables of a TOML file."""

    path: str
    tables: Mapping[str, Any]
    digests: tuple[tuple[str, str], ...] = ()  # of ``only`` some tables: name and hash of each file that they name

    @classmethod
    def of(cls, given: str | StudyFile, required: Set[str] = frozenset({"beam"})) -> StudyFile:
        """Read a TOML file by its name, with the tables that must be there; a file that was read stays as it is."""
        if isinstance(given, StudyFile):
            return given
        if is_document(given):
            raise InputError(
                "a document holds only beam and damping; write a TOML file with [beam] document = "
                f'"{Path(given).name}"',
                given,
            )
        tables = read_toml(given)
        check_keys(tables, set(required), FILE_TABLES, given)
        return cls(given, tables)

    def where(self, name: str) -> str:
        """Return the place of a table, for messages."""
        return f"{self.path}: [{name}]"

    def needed(self, name: str, why: str = "--help lists its keys") -> Any:
        """Return a table that the command needs."""
        if name not in self.tables:
            raise InputError(f"the table is missing; {why}", self.where(name))
        return self.tables[name]

    def several(self, name: str) -> list[Any]:
        """Return the tables of one name, [name] or several [[name]]; none if there is no such table."""
        given = self.tables.get(name, [])
        if isinstance(given, dict):
            return [given]
        if not isinstance(given, list):
            raise InputError(f"must be a table [{name}], or several [[{name}]]", self.path)
        return given

    def beside(self, name: Any, where: str) -> Path:
        """Return the path of a file that a table names, relative to the folder of this file."""
        if not isinstance(name, str):
            raise InputError(f"must be the name of a file, got {shown(name)}", where)
        return Path(self.path).parent / name

    def only(self, names: Set[str]) -> StudyFile:
        """Return the file with the tables of the given names alone, as far as they are there, and with their hashes."""
        tables = {name: table for name, table in self.tables.items() if name in names}
        return StudyFile(self.path, tables, tuple((name, self._digest(name)) for name in sorted(set(_named(tables)))))

    def _digest(self, name: str) -> str:
        """Return the hash of a file, or an empty one if it cannot be read, which the reader of the table reports."""
        try:
            with opened(self.beside(name, self.path)) as content:
                return hashlib.file_digest(content, "sha256").hexdigest()
        except InputError:
            return ""


NO_FILE = StudyFile("", {})


def _named(tables: Any) -> Iterator[str]:
    """Yield the names of files in tables."""
    if isinstance(tables, dict):
        for key, value in tables.items():
            if key in NAMING and isinstance(value, str):
                yield value
            else:
                yield from _named(value)
    elif isinstance(tables, list):
        for value in tables:
            yield from _named(value)


def is_document(path: str) -> bool:
    """Return whether a file is a JSON document, by its name."""
    return Path(path).suffix.lower() == ".json"
