"""Which settings are secrets, known from their declaration alone.

A setting of the type ``SecretStr`` is one. In free settings (a mapping of anything) it is what stands below the keys
that ``SecretKeys`` in their declaration names. A secret is told nowhere: the text of the file as recordings hold it,
the settings that outlets publish and messages about mistakes have ``***`` in its place. Secrets within addresses are
known by their form (``cellwatt.host``).
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
    """Put with ``Annotated`` into the declaration of free settings: below keys that hold such a word are secrets."""

    words: tuple[str, ...]

    def name(self, key: object) -> bool:
        """True if a key names a secret."""
        return any(word in str(key).lower() for word in self.words)


def secrets_in(kind: Any, values: Mapping[Any, Any], path: KeyPath = ()) -> list[KeyPath]:
    """Paths of the secrets among settings as they are written at ``path``, right or wrong."""
    found: list[KeyPath] = []

    def note(at: KeyPath, types: Types, value: Any) -> Any:
        if any(map(_is_secret, types)):
            found.append(at)
        return value

    each_value(members(kind), values, note, path, _inside)
    return found


def _inside(types: Types, key: object) -> Types:
    """As ``below``; what stands in a secret is one, whatever its form, and so is what is under a key that names one."""
    marks = [each for each in types if isinstance(each, SecretKeys)]
    if any(map(_is_secret, types)) or any(mark.name(key) for mark in marks):
        return [SecretStr]
    return [*marks, *below(types, key)]


def _is_secret(annotation: Any) -> bool:
    return annotation is SecretStr or any(map(_is_secret, get_args(annotation)))
