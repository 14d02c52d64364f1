"""The help on tables, made from their declarations."""

from __future__ import annotations

import textwrap
import typing
from collections.abc import Mapping
from typing import Any

from msgspec import inspect as types

from ancf_casadi.support.specs import alternatives, listed_fields, plain

Kinds = Mapping[str, tuple[Any, ...]]  # the declarations of each kind of a table, whose keys stand side by side


def table_help(head: str, text: str, *declared: type, indent: int = 16, base: type | None = None) -> str:
    """Return the help on a table: its head, and beside it a text in which each {} stands for the keys of a class."""
    full = f"  {head} ".ljust(indent) + text.format(*(", ".join(described_keys(kind, base)) for kind in declared))
    return _folded(full, 80, " " * indent) + "\n"


def kinds_help(head: str, kinds: Kinds) -> str:
    """Return the help on a table of several kinds."""
    keys = {name: [key for kind in declared for key in described_keys(kind)] for name, declared in kinds.items()}
    lines = [_folded(f"{name}: {', '.join(listed)}", 64) for name, listed in keys.items()]
    return f"  {head}\n" + textwrap.indent("\n".join(lines), " " * 16) + "\n"


def tagged_help(head: str, kinds: Any) -> str:
    """Return the help on a table of several kinds, which a key tells apart."""
    infos: list[Any] = [plain(types.type_info(kind)) for kind in typing.get_args(kinds)]
    return kinds_help(head, {f'{info.tag_field} = "{info.tag}"': (info.cls,) for info in infos})


def _folded(text: str, width: int, indent: str = "") -> str:
    return textwrap.fill(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def described_keys(kind: type, base: type | None = None) -> list[str]:
    """Return the keys that a class declares beyond its base, each with its description."""
    base_keys = described_keys(base) if base else []
    return [key for field in listed_fields(kind) if (key := _described(field)) not in base_keys]


def description(field: types.Field) -> str:
    """Return the description of a key; empty if it has none."""
    declared = field.type
    return (declared.extra_json_schema or {}).get("description", "") if isinstance(declared, types.Metadata) else ""


def _described(field: types.Field) -> str:
    """Return a key with its description, or the names that it may have."""
    note = description(field)
    for kind in alternatives(field.type):
        if isinstance(kind, types.LiteralType):
            note = note or " or ".join(f'"{value}"' for value in kind.values if value)
        elif isinstance(kind, types.BoolType):
            note = f"true or false{note and f': {note}'}"
    if note[:1] in ("[", "{"):
        return f"{field.encode_name} = {note}"
    return f"{field.encode_name} ({note})" if note else field.encode_name
