"""Settings classes as reference documentation: key, type, default, meaning."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from cellwatt.quantity import TABLES

_PLAIN = re.compile(r"[A-Za-z/][A-Za-z0-9_./+-]*(?: [A-Za-z0-9_./+-]+)*|[0-9]+(?:\.[0-9]+){3}")
_WORDS = ("true", "false", "null")


@dataclass(frozen=True, slots=True)
class Field:
    """One key of a settings class; ``default`` is the text to write in a file, ``""`` if the key is required."""

    key: str
    type: str
    default: str
    required: bool
    description: str


def reference(model: type[BaseModel]) -> list[Field]:
    """All keys of a settings class; keys of nested settings are dotted."""
    schema = model.model_json_schema(by_alias=True)
    return list(_fields(schema, schema.get("$defs", {}), "", ()))


def in_yaml(value: str) -> str:
    """A text as YAML, in quotes if it would otherwise be read as something else."""
    if _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
        return value
    return json.dumps(value, ensure_ascii=False)


def written(value: object, schema: Mapping[str, Any]) -> str:
    """A default as text for a settings file: the duration ``0.1`` becomes ``100 ms``."""
    if value is None:
        return ""
    example = _example(schema)
    if example is not None and isinstance(value, int | float):
        return _quantity(float(value), example.rsplit(" ", 1)[-1])
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"[{', '.join(in_yaml(v) if isinstance(v, str) else written(v, {}) for v in value)}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{k}: {written(v, {})}' for k, v in value.items())}}}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _fields(
    schema: Mapping[str, Any], shared: Mapping[str, Any], prefix: str, above: tuple[str, ...]
) -> Iterator[Field]:
    required = schema.get("required", ())
    for key, found in schema.get("properties", {}).items():
        default = "" if key in required else written(found.get("default"), found)
        description = " ".join(found.get("description", "").split()).replace("``", "")
        yield Field(prefix + key, _type(found, shared), default, key in required, description)
        for name, below, inner in _nested(found, shared):
            if name not in above:
                yield from _fields(below, shared, f"{prefix}{key}{inner}.", (*above, name))


def _nested(schema: Mapping[str, Any], shared: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any], str]]:
    """Nested settings of a value: name, schema, and the suffix of the key that leads to them."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[-1]
        if "properties" in shared[name]:
            yield name, shared[name], ""
    for option in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("allOf", ())):
        yield from _nested(option, shared)
    if isinstance(schema.get("items"), dict):
        yield from ((n, s, f"[]{k}") for n, s, k in _nested(schema["items"], shared))
    if isinstance(schema.get("additionalProperties"), dict):
        yield from ((n, s, f".NAME{k}") for n, s, k in _nested(schema["additionalProperties"], shared))


def _type(schema: Mapping[str, Any], shared: Mapping[str, Any]) -> str:
    if "$ref" in schema:
        return _type(shared[schema["$ref"].rsplit("/", 1)[-1]], shared)
    options = schema.get("anyOf") or schema.get("oneOf") or schema.get("allOf")
    if options:
        names = [_type(o, shared) for o in options if o.get("type") != "null"]
        return " or ".join(dict.fromkeys(names))
    if "const" in schema:
        return str(schema["const"])
    if "enum" in schema:
        return " | ".join(str(v) for v in schema["enum"])
    example = _example(schema)
    if example is not None:
        return f"quantity, like {example}"
    kind = schema.get("type")
    if kind == "array":
        items = schema.get("items")
        return f"list of {_type(items, shared)}" if items else "list"
    if kind == "object":
        inner = schema.get("additionalProperties")
        return f"NAME: {_type(inner, shared)}" if isinstance(inner, dict) else "settings"
    plain = {"integer": "whole number", "number": "number", "boolean": "true | false", "string": "text"}
    text = "path" if "path" in str(schema.get("format")) else plain.get(str(kind), "anything")
    return text + _range(schema)


def _range(schema: Mapping[str, Any]) -> str:
    low, high = schema.get("minimum"), schema.get("maximum")
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    limits = [f"≥ {low}" * (low is not None), f"> {above}" * (above is not None)]
    limits += [f"≤ {high}" * (high is not None), f"< {below}" * (below is not None)]
    text = ", ".join(part for part in limits if part)
    return f" ({text})" if text else ""


def _example(schema: Mapping[str, Any]) -> str | None:
    """The example of a quantity, or ``None`` for any other type."""
    for option in (schema, *schema.get("anyOf", ())):
        examples = option.get("examples")
        if option.get("type") == "string" and examples and _ladder(str(examples[0]).rsplit(" ", 1)[-1]):
            return str(examples[0])
    return None


def _ladder(unit: str) -> dict[str, float] | None:
    """The units of the quantity that has this unit, largest first."""
    table = next((table for table in TABLES if unit in table), None)
    return table and dict(sorted(table.items(), key=lambda known: -known[1]))


def _quantity(value: float, unit: str) -> str:
    ladder = _ladder(unit) or {unit: 1.0}
    fitting = {u: value / f for u, f in ladder.items() if abs(value) / f >= 1 - 1e-9}
    whole = {u: n for u, n in fitting.items() if abs(n - round(n)) < 1e-9 * abs(n)}
    name, number = next(iter((whole or fitting or {unit: value / ladder[unit]}).items()))
    return f"{number:g} {name}"
