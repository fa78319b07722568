"""JSON Schema of a settings file, for editors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from cellwatt.config.cell import CellName, FrameSettings
from cellwatt.config.installed import Part, installed
from cellwatt.config.reference import written
from cellwatt.record.settings import RecordSettings
from cellwatt.units import Units

_NAMES = {"pattern": "^[a-z][a-z0-9_]*$"}

Schema = dict[str, Any]


def json_schema() -> Schema:
    """The schema of a settings file with every driver, stage and outlet that is installed here."""
    parts = installed()
    models: list[type[BaseModel]] = [CellName, FrameSettings, RecordSettings, Units]
    models += [p.settings for p in parts if p.settings is not None]
    refs, shared = models_json_schema([(m, "validation") for m in dict.fromkeys(models)])
    definitions: Schema = shared.get("$defs", {})
    for definition in definitions.values():
        _written_defaults(definition)
    inline = {model: _inline(refs[model, "validation"], definitions) for model in dict.fromkeys(models)}
    by_kind = {kind: [p for p in parts if p.kind == kind] for kind in ("driver", "stage", "outlet")}
    name = inline[CellName]
    properties: Schema = {
        **name["properties"],
        "sources": {
            "description": "What is measured: a name of your own for each device, and its driver's settings.",
            "type": "object",
            "minProperties": 1,
            "propertyNames": _NAMES,
            "additionalProperties": _chosen("driver", by_kind["driver"], inline),
        },
        "frames": _optional(inline[FrameSettings]),
        "stages": _stages(by_kind["stage"], inline),
        "record": _optional(inline[RecordSettings]),
        "units": _optional(inline[Units]),
        **{p.name: _outlet(p, inline) for p in by_kind["outlet"]},
    }
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "cellwatt cell",
        "type": "object",
        "additionalProperties": False,
        "required": [*name["required"], "sources"],
        "properties": properties,
        "$defs": definitions,
    }


def _written_defaults(definition: Schema) -> None:
    """Give quantities their defaults as written, not in base units; editors insert them."""
    for found in definition.get("properties", {}).values():
        default = found.get("default")
        text = written(default, found)
        if isinstance(default, float) and text != written(default, {}):
            found["default"] = text


def _inline(ref: Mapping[str, Any], definitions: Schema) -> Schema:
    found: Schema = definitions[str(ref["$ref"]).rsplit("/", 1)[-1]]
    return found


def _optional(schema: Schema) -> Schema:
    """Settings that may be left empty (``segment:``)."""
    return {**schema, "type": ["object", "null"]} if not schema.get("required") else schema


def _of(part: Part, inline: Mapping[type[BaseModel], Schema]) -> Schema:
    if part.settings is None:
        return {"type": "object", "description": part.title}
    return inline[part.settings]


def _with(key: str, part: Part, inline: Mapping[type[BaseModel], Schema]) -> Schema:
    """A part's settings beside the key that chooses it."""
    schema = _of(part, inline)
    own = {key: {"const": part.name, "description": part.title}}
    return {
        **schema,
        "properties": {**own, **schema.get("properties", {})},
        "required": [key, *schema.get("required", ())],
    }


def _chosen(key: str, parts: Sequence[Part], inline: Mapping[type[BaseModel], Schema]) -> Schema:
    """Settings whose shape ``key`` decides."""
    choices = [
        {"if": {"properties": {key: {"const": p.name}}, "required": [key]}, "then": _with(key, p, inline)}
        for p in parts
    ]
    titles = "\n".join(f"{p.name}: {p.title}" for p in parts)
    return {
        "type": "object",
        "required": [key],
        "properties": {key: {"enum": [p.name for p in parts], "description": titles}},
        "allOf": choices,
    }


def _stages(parts: Sequence[Part], inline: Mapping[type[BaseModel], Schema]) -> Schema:
    chosen = _chosen("stage", parts, inline)
    direct = {
        p.name: {
            "description": p.title,
            "if": {"type": "object", "required": ["stage"]},
            "then": chosen,
            "else": _optional(_of(p, inline)),
        }
        for p in parts
    }
    return {
        "description": "What is learned from the frames: a stage by its kind, or by your own name with 'stage: KIND'.",
        "type": ["object", "null"],
        "propertyNames": _NAMES,
        "properties": direct,
        "additionalProperties": chosen,
    }


def _outlet(part: Part, inline: Mapping[type[BaseModel], Schema]) -> Schema:
    off = {"enum": ["off", False], "description": f"No {part.name}."}
    return {"description": part.title, "anyOf": [_optional(_of(part, inline)), off]}
