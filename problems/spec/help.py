"""The help on the tables of a file, made from their JSON Schema."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

Schema = Mapping[str, Any]


def keys_help(schema: Schema) -> str:
    """Return all tables with their keys as text."""
    lines = ["tables of a TOML file, in SI units; names of files start at its folder:"]
    fold = textwrap.TextWrapper(80, " " * 6, " " * 8, break_long_words=False, break_on_hyphens=False).wrap
    for head, kinds in sections(schema):
        lines.append(f"  {head}")
        first, *others = [kind["properties"] for kind in kinds]
        shared = {
            key: value for key, value in first.items() if others and all(keys.get(key) == value for keys in others)
        }
        lines += fold(f"each has {_describe(shared)}") if shared else []
        for kind in kinds:
            keys = {key: value for key, value in kind["properties"].items() if key not in shared}
            text = kind["description"].rstrip(".")
            lines += fold(": ".join([text, _describe(keys)]) if keys else text)
    return "\n".join(lines) + "\n"


def sections(schema: Schema) -> Iterator[tuple[str, list[Schema]]]:
    """Yield each table, and each within it, with the alternatives of its keys; equal tables once."""
    listed: list[list[Schema]] = []
    for name, table in schema["properties"].items():
        properties = [item for kind in tables(table, schema["$defs"]) for item in kind["properties"].items()]
        for place, inner in ((name, table), *((f"{name}.{key}", value) for key, value in properties)):
            kinds = tables(inner, schema["$defs"])
            if kinds and kinds not in listed:
                listed.append(kinds)
                several = any(alternative.get("type") == "array" for alternative in (inner, *inner.get("anyOf", ())))
                yield f"[[{place}]]" if several else f"[{place}]", kinds


def tables(schema: Schema, definitions: Schema) -> list[Schema]:
    """Return the tables with keys among the alternatives of a schema, and among those to which it refers."""
    if "$ref" in schema:
        return tables(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    alternatives = [schema] if "properties" in schema else []
    for inner in (*schema.get("anyOf", ()), schema.get("items"), schema.get("additionalProperties")):
        alternatives += [table for table in tables(inner, definitions) if table not in alternatives] if inner else []
    return alternatives


def _describe(properties: Schema) -> str:
    """Return keys with their descriptions, or with the values that they may have."""
    texts = []
    for key, value in properties.items():
        note = value.get("description", "")
        for kind in value.get("anyOf", (value,)):
            if choices := kind.get("enum"):
                note = note or " or ".join(json.dumps(name) for name in choices if name)
            elif kind.get("type") == "boolean":
                note = f"true or false{note and f': {note}'}"
        assigned = "const" in value or note[:1] in ("[", "{")
        note = json.dumps(value["const"]) if "const" in value else note
        texts.append(f"{key} = {note}" if assigned else f"{key} ({note})" if note else key)
    return ", ".join(texts)
