"""Finds secret settings by their declaration.

A setting of the type ``SecretStr`` is a secret. In free settings (a mapping of anything), the values below the keys
that their declaration lists in ``SecretKeys`` are secrets. Secrets are never published: the text of the file in
recordings, the settings that outlets publish and error messages contain ``***`` instead. Secrets within addresses are
recognised by their form (``cellwatt.host``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import SecretStr

from cellwatt.config.fields import Types, below, each_value, members
from cellwatt.config.places import KeyPath


@dataclass(frozen=True, slots=True)
class SecretKeys:
    """Metadata for ``Annotated`` free settings: values below keys that contain one of the words are secrets."""

    words: tuple[str, ...]

    def name(self, key: object) -> bool:
        """True if a key names a secret."""
        return any(word in str(key).lower() for word in self.words)


def secrets_in(kind: Any, values: Mapping[Any, Any], path: KeyPath = ()) -> list[KeyPath]:
    """Key paths of the secrets in unvalidated settings at ``path``."""
    found: list[KeyPath] = []

    def note(at: KeyPath, types: Types, value: Any) -> Any:
        if any(map(_is_secret, types)):
            found.append(at)
        return value

    each_value(members(kind), values, note, path, _inside)
    return found


def _inside(types: Types, key: object) -> Types:
    """Like ``below``; everything inside a secret, and below a key that names a secret, is a secret too."""
    marks = [each for each in types if isinstance(each, SecretKeys)]
    if any(map(_is_secret, types)) or any(mark.name(key) for mark in marks):
        return [SecretStr]
    return [*marks, *below(types, key)]


def _is_secret(annotation: Any) -> bool:
    return annotation is SecretStr or any(map(_is_secret, get_args(annotation)))
