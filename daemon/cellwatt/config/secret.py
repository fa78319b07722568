"""Which settings are secrets, known from their declaration alone.

A setting of the type ``SecretStr`` is one. In free settings (a mapping of anything) it is what stands below the keys
that ``SecretKeys`` in their declaration names. A secret is told nowhere: the text of the file as recordings hold it,
the settings that outlets publish and messages about mistakes have ``***`` in its place. Secrets within addresses are
known by their form (``cellwatt.host``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, SecretStr

from cellwatt.config.fields import fields_of, models_in
from cellwatt.config.places import KeyPath


@dataclass(frozen=True, slots=True)
class SecretKeys:
    """Put with ``Annotated`` into the declaration of free settings: below keys that hold such a word are secrets."""

    words: tuple[str, ...]

    def name(self, key: object) -> bool:
        """True if a key names a secret."""
        return any(word in str(key).lower() for word in self.words)


def secrets_in(model: type[BaseModel], values: Mapping[Any, Any], path: KeyPath) -> Iterator[KeyPath]:
    """Paths of the secrets among settings as they are written at ``path``, right or wrong."""
    fields = fields_of(model)
    for key, value in values.items():
        field = fields.get(str(key))
        if field is None:
            continue
        marks = [mark for mark in field.metadata if isinstance(mark, SecretKeys)]
        if marks:
            yield from (at for mark in marks for at in _below(mark, value, (*path, key)))
        elif _is_secret(field.annotation):
            yield from _leaves(value, (*path, key))
        else:
            for inner in models_in(field.annotation):
                yield from _inside(inner, value, (*path, key))


def _inside(model: type[BaseModel], value: Any, path: KeyPath) -> Iterator[KeyPath]:
    """Secrets of settings that are a value, or stand in its lists, or below names of their own."""
    if isinstance(value, dict):
        yield from secrets_in(model, value, path)
    for key, inner in _items(value):
        if isinstance(inner, dict | list):
            yield from _inside(model, inner, (*path, key))


def _below(mark: SecretKeys, value: Any, path: KeyPath) -> Iterator[KeyPath]:
    for key, inner in _items(value):
        if isinstance(key, str) and mark.name(key):
            yield from _leaves(inner, (*path, key))
        else:
            yield from _below(mark, inner, (*path, key))


def _leaves(value: Any, path: KeyPath) -> Iterator[KeyPath]:
    if not isinstance(value, dict | list):
        yield path
    for key, inner in _items(value):
        yield from _leaves(inner, (*path, key))


def _items(value: Any) -> list[tuple[Any, Any]]:
    if isinstance(value, dict):
        return list(value.items())
    return list(enumerate(value)) if isinstance(value, list) else []


def _is_secret(annotation: Any) -> bool:
    return annotation is SecretStr or any(_is_secret(argument) for argument in get_args(annotation))
