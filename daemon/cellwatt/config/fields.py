"""Structure of a settings class: the keys allowed at a key path, and which of them are file paths."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from cellwatt.config.places import KeyPath

Types = list[Any]
"""The types allowed for a value: members of its union, and the metadata of its ``Annotated``."""


def fields_of(model: type[Any]) -> dict[str, FieldInfo]:
    """Fields of a settings class or a dataclass, by their key in the file."""
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


def members(annotation: Any) -> Types:
    """The members of ``X | Y``, and the metadata of ``Annotated``."""
    if get_origin(annotation) in (Union, UnionType, Annotated):
        return [member for argument in get_args(annotation) for member in members(argument)]
    return [annotation]


def below(types: Types, key: object) -> Types:
    """The types allowed under a key of a mapping, or for an item of a list, of these types.

    If a user's own name in a mapping is also a field's key, both types are allowed.
    """
    models = [model for each in types for model in models_in(each)]
    known = [fields[str(key)] for fields in map(fields_of, models) if str(key) in fields]
    free = [member for each in types for argument in get_args(each) for member in members(argument)]
    return [one for field in known for one in (*field.metadata, *members(field.annotation))] + free


def fields_at(kind: Any, path: KeyPath) -> dict[str, FieldInfo]:
    """Fields allowed in the mapping at ``path`` below ``kind``, a settings class or a type that contains one.

    Keys of mappings with free names are skipped.
    """
    models = models_in(kind)
    for part in path:
        models = [model for each in below([*models], part) for model in models_in(each)] or models
    return {key: field for model in models for key, field in fields_of(model).items()}


def each_value(
    types: Types,
    value: Any,
    change: Callable[[KeyPath, Types, Any], Any],
    path: KeyPath = (),
    inside: Callable[[Types, object], Types] = below,
) -> Any:
    """``value`` with each scalar replaced by ``change(path, types, scalar)``."""
    if isinstance(value, dict):
        items = (
            (key, each_value(inside(types, key), item, change, (*path, key), inside)) for key, item in value.items()
        )
        return dict(items)
    if isinstance(value, list):
        types = inside(types, None)
        return [each_value(types, item, change, (*path, i), inside) for i, item in enumerate(value)]
    return change(path, types, value)


def anchored(kind: Any, value: Any, folder: Path) -> Any:
    """``value`` with each relative path resolved against ``folder``, where ``kind`` declares a ``Path``.

    ``~`` at the start of a path is the home folder of the user.
    """

    def start(_: KeyPath, types: Types, found: Any) -> Any:
        is_path = any(isinstance(each, type) and issubclass(each, Path) for each in types)
        return str(folder / Path(found).expanduser()) if is_path and isinstance(found, str) else found

    return each_value(members(kind), value, start)
