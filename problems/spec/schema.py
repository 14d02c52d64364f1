"""The JSON Schema (draft 2020-12) of a TOML file, by which editors complete and check its keys.

It is made from the declarations of the tables.  A table whose keys come from several declarations has the keys of all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, get_type_hints

import msgspec

from ancf_casadi.damping.spec import LawSpec
from ancf_casadi.mechanics.spec import BeamSpec, ConfigurationSpec
from ancf_casadi.support.specs import listed_fields
from problems.spec import motion, plan, record_files, records
from problems.spec.beam import DocumentName
from problems.spec.match import MatchTable

SCHEMA_FILE = "study.schema.json"
Alternatives = dict[str, list[tuple[Any, ...]]]

ONE: Alternatives = {  # tables of the file, by the alternatives of their keys, each of one or several declarations
    "beam": [(BeamSpec,), (DocumentName,)],
    "match": [(MatchTable,)],
    "base": list(dict.fromkeys(motion.BASE_KINDS.values())),
    "load": list(dict.fromkeys(motion.LOAD_KINDS.values())),
    "release": [(motion.ReleaseSpec,)],
    "simulation": [(motion.SimulationSpec,)],
    "response": [(motion.ResponseSpec,)],
    "fit": [(records.FitSpec,)],
    "plan": [(plan.PlanSpec,)],
}  # fmt: skip
OF_SENSOR = (record_files.SensorSpec, ConfigurationSpec)
CANDIDATE = (plan.CandidateSpec, ConfigurationSpec)
PLANNED = (plan.PlannedChannelSpec, record_files.SensorSpec)
SEVERAL: Alternatives = {  # tables of which the file may have several
    "records": [(records.MotionSpec, ConfigurationSpec, record_files.ChannelSpec, record_files.SensorSpec)],
    "curves": [(records.CurveSpec, kind, *OF_SENSOR) for kind in (record_files.CurveFileSpec, records.CurveValuesSpec)],
    "statics": [
        (records.StaticSpec, records.LoadsSpec, records.StaticValuesSpec, *OF_SENSOR),
        (records.StaticSpec, records.StaticFileSpec, record_files.StaticColumnSpec, *OF_SENSOR),
    ],
    "frequencies": [(records.FrequenciesSpec, ConfigurationSpec)],
    "candidates": [
        (plan.PlannedMotionSpec, *CANDIDATE, *PLANNED),
        (records.StaticTestSpec, records.LoadsSpec, *CANDIDATE, *PLANNED),
        (plan.PlannedFrequenciesSpec, *CANDIDATE),
        (plan.PlannedCurveSpec, *CANDIDATE, record_files.SensorSpec),
    ],
}


def file_schema(study: type, further: Mapping[str, type], steps: Mapping[str, type]) -> dict[str, Any]:
    """Return the schema, with the declarations of [study], of further tables, and of the kinds of [[steps]]."""
    definitions: dict[str, Any] = {}
    properties = {name: _table(kinds, definitions) for name, kinds in (ONE | {"study": [(study,)]}).items()}
    several = {name: _table(kinds, definitions, whole=False) for name, kinds in SEVERAL.items()}  # of channels as well
    several |= {name: object_schema((declared,), definitions) for name, declared in further.items()}
    kinds = [object_schema((kind,), definitions) for kind in steps.values()]
    for name, kind in zip(steps, kinds, strict=True):
        kind["properties"] = {"kind": {"const": name}, **kind["properties"]}
    several |= {"damping": _describe(LawSpec, definitions), "steps": {"anyOf": kinds}}
    for name, table in several.items():
        definitions[name] = table
        reference = {"$ref": f"#/$defs/{name}"}
        properties[name] = {"anyOf": [reference, {"type": "array", "items": reference}]}
    properties["predictions"] = properties["records"]
    properties["markers"] = {"type": "object", "additionalProperties": {"type": "number"}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A study of ancf-casadi",
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
        "$defs": definitions,
    }


def _table(kinds: list[tuple[Any, ...]], definitions: dict[str, Any], *, whole: bool = True) -> dict[str, Any]:
    """Return the schema of a table with alternatives of keys."""
    tables = [object_schema(declarations, definitions, whole=whole) for declarations in kinds]
    return tables[0] if len(tables) == 1 else {"anyOf": tables}


def object_schema(declarations: tuple[Any, ...], definitions: dict[str, Any], *, whole: bool = True) -> dict[str, Any]:
    """Return the schema of a table that has the keys of several declarations, some of them elsewhere if not whole."""
    properties: dict[str, Any] = {}
    required: list[str] = []
    for declared in declarations:
        hints = get_type_hints(declared, include_extras=True)
        for field in listed_fields(declared):
            properties[field.encode_name] = _describe(hints[field.name], definitions) | _default(field.default)
            required += [field.encode_name] if field.required else []
    description = " ".join(declarations[0].__doc__.partition("\n\n")[0].split())
    schema = {"type": "object", "description": description, "properties": properties}
    return schema | {"additionalProperties": False} | ({"required": required} if required and whole else {})


def _default(value: Any) -> dict[str, Any]:
    """Return the default of a key, if it is worth telling."""
    plain = msgspec.to_builtins(value) if isinstance(value, str | int | float | tuple) else None
    return {} if plain in (None, "", (), math.inf) or plain != plain else {"default": plain}


def _describe(hint: Any, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a type, and add the definitions to which it refers."""
    (schema,), components = msgspec.json.schema_components([hint], ref_template="#/$defs/{name}")
    definitions |= components
    return schema
