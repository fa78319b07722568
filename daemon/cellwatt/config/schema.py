"""JSON Schema of a settings file, for editors."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, create_model
from pydantic.config import JsonDict

from cellwatt.config.cell import CellName, FrameSettings
from cellwatt.config.installed import Installed, installed
from cellwatt.config.reference import written
from cellwatt.record.settings import RecordSettings
from cellwatt.units import Units

_NAMES: JsonDict = {"propertyNames": {"pattern": "^[a-z][a-z0-9_]*$"}}


def json_schema() -> dict[str, Any]:
    """The schema of a settings file with all installed drivers, stages and outlets."""
    own = _chosen("stage", installed("stage"))

    class Stages(BaseModel, extra="allow", json_schema_extra=_NAMES):
        """Analysis of the frames: each stage under its kind, or under your own name with 'stage: KIND'."""

        __pydantic_extra__: dict[str, own]  # type: ignore[valid-type]  # built from the installed stages

    kinds: dict[str, Any] = {p.name: _optional(_settings(p) | own, p.title) for p in installed("stage")}
    fields: dict[str, Any] = {
        "sources": (
            dict[str, _chosen("driver", installed("driver"))],  # type: ignore[misc]
            Field(
                min_length=1,
                description="What is measured: a name of your own for each device, and its driver's.",
                json_schema_extra=_NAMES,
            ),
        ),
        "frames": _optional(FrameSettings, FrameSettings.__doc__),
        "stages": _optional(create_model("Stages", __base__=Stages, **kinds), Stages.__doc__),
        "record": _optional(RecordSettings, RecordSettings.__doc__),
        "units": _optional(Units, Units.__doc__),
        **{p.name: _optional(_settings(p) | Literal["off", "no", False], p.title) for p in installed("outlet")},
    }
    schema = create_model("cellwatt cell", __base__=CellName, **fields).model_json_schema()
    for definition in schema["$defs"].values():
        _written_defaults(definition)
    return {"$schema": "http://json-schema.org/draft-07/schema#", **schema}


def _chosen(key: str, parts: Sequence[Installed]) -> Any:
    """Settings whose class the value of ``key`` selects."""
    choices = [_with(key, part) for part in parts]
    return Annotated[reduce(or_, choices), Field(discriminator=key)] if len(choices) > 1 else choices[0]


def _with(key: str, part: Installed) -> Any:
    """The settings of a driver, stage or outlet, with the key that selects it."""
    chosen: dict[str, Any] = {key: (Literal[part.name], Field(description=part.title))}
    return create_model(f"{part.kind} {part.name}", __base__=_settings(part), __doc__=part.title, **chosen)


class _Anything(BaseModel):
    """Settings of a driver, stage or outlet that cannot be loaded."""

    model_config = ConfigDict(extra="allow")


def _settings(part: Installed) -> Any:
    return part.settings or _Anything


def _optional(kind: Any, description: str | None) -> tuple[Any, Any]:
    """A field that may be left empty (``segment:``)."""
    return kind | None, Field(None, description=description)


def _written_defaults(definition: dict[str, Any]) -> None:
    """Replace the defaults of quantities in base units by text with a unit, as editors insert them."""
    for found in definition.get("properties", {}).values():
        default = found.get("default")
        text = written(default, found)
        if isinstance(default, float) and text != written(default, {}):
            found["default"] = text
