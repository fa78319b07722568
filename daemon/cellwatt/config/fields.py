"""Structure of a settings class: its keys at a place, and which of them are paths."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from cellwatt.config.places import KeyPath


def fields_of(model: type[Any]) -> dict[str, FieldInfo]:
    """Fields of a settings class or a dataclass by the key that is written in the file."""
    if not issubclass(model, BaseModel):
        hints = get_type_hints(model, include_extras=True)
        return {field.name: _info(hints[field.name], field) for field in dataclasses.fields(model)}
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _info(annotation: Any, field: dataclasses.Field[Any]) -> FieldInfo:
    if field.default is field.default_factory is dataclasses.MISSING:
        return FieldInfo.from_annotation(annotation)
    return FieldInfo.from_annotated_attribute(annotation, field.default)


def models_in(annotation: Any) -> list[type[Any]]:
    """Settings classes within a type, e.g. in ``dict[str, Tolerance] | None``."""
    if isinstance(annotation, type) and (issubclass(annotation, BaseModel) or dataclasses.is_dataclass(annotation)):
        return [annotation]
    return [model for argument in get_args(annotation) for model in models_in(argument)]


def fields_at(kind: Any, path: KeyPath) -> dict[str, FieldInfo]:
    """Fields allowed in the mapping at ``path`` below a settings class, or a type that holds some.

    Keys of free mappings are passed over.
    """
    models = models_in(kind)
    for part in path:
        inner = [i for m in models for i in models_in(_annotation(m, part))]
        models = inner or models
    return {key: field for m in models for key, field in fields_of(m).items()}


def anchored(annotation: Any, value: Any, folder: Path) -> Any:
    """``value`` with relative paths, wherever ``annotation`` has a ``Path``, starting at ``folder``."""
    if isinstance(value, str):
        return str(folder / value) if _holds_path(annotation) else value
    if isinstance(value, list):
        inside = get_args(annotation) or (annotation,)
        return [_first_change(inside, item, folder) for item in value]
    if isinstance(value, dict):
        models = models_in(annotation)
        inside = get_args(annotation)
        return {
            key: _first_change([_annotation(m, key) for m in models] or inside, item, folder)
            for key, item in value.items()
        }
    return value


def _first_change(annotations: Iterable[Any], value: Any, folder: Path) -> Any:
    for annotation in annotations:
        changed = anchored(annotation, value, folder)
        if changed != value:
            return changed
    return value


def _annotation(model: type[Any], key: str | int) -> Any:
    field = fields_of(model).get(str(key))
    return field.annotation if field is not None else None


def _holds_path(annotation: Any) -> bool:
    """True if a single text of this type is a path (``Path``, ``FilePath | None``, but not ``list[Path]``)."""
    if isinstance(annotation, type):
        return issubclass(annotation, Path)
    origin = getattr(annotation, "__origin__", None)
    if isinstance(origin, type) and issubclass(origin, list | tuple | set | dict):
        return False
    return any(_holds_path(a) for a in get_args(annotation))
