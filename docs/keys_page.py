"""Write the reference page of the keys of study files, from the JSON Schema that is made from their declarations."""

from __future__ import annotations

import json
from pathlib import Path

from problems.spec.help import Schema, sections
from problems.study.study import study_schema

HEAD = """\
# Keys of a study file

All tables of a TOML file with their keys, made from their declarations. Units are SI; a relative file name starts at
the folder of the file. `ancf-casadi init` writes a file to start from, and `study.schema.json`, by which an editor
completes these keys
([studies](../how_to/studies.md#let-an-editor-complete-the-keys)).
"""
KINDS = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false",
         "object": "table"}  # fmt: skip


def write_keys_page(path: Path) -> None:
    """Write the page."""
    schema = study_schema()
    texts = [_section(head, kinds, schema["$defs"]) for head, kinds in sections(schema)]
    path.write_text("\n".join([HEAD, *texts]), encoding="utf-8")


def _section(head: str, kinds: list[Schema], definitions: Schema) -> str:
    lines = [f"## {head}", ""]
    for kind in kinds:
        tags = [
            f"{key} = {json.dumps(value['const'])}" for key, value in kind["properties"].items() if "const" in value
        ]
        lines += [f"{kind.get('description', '')} {'`' + tags[0] + '`' if tags else ''}".strip(), ""]
        lines += ["| key | value | default | |", "|---|---|---|---|"]
        for key, value in kind["properties"].items():
            if "const" not in value:
                default = json.dumps(value["default"]) if "default" in value else ""
                cells = (
                    f"`{key}`",
                    _kind(value, definitions),
                    default and f"`{default}`",
                    value.get("description", ""),
                )
                lines.append(f"| {' | '.join(cell.replace('|', ' or ') for cell in cells)} |")
        lines.append("")
    return "\n".join(lines)


def _kind(schema: Schema, definitions: Schema) -> str:
    """Return the values that a schema allows, in words."""
    if "$ref" in schema:
        return _kind(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    if "anyOf" in schema:
        kinds = dict.fromkeys(_kind(alternative, definitions) for alternative in schema["anyOf"])
        return " or ".join(kind for kind in kinds if kind)
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    if schema.get("type") == "array":
        items = schema.get("prefixItems") or [schema.get("items", {})]
        return f"{'pair' if len(items) == 2 else 'list'} of {_kind(items[0], definitions) or 'value'}s"
    return KINDS.get(schema.get("type", ""), "")
