"""``${NAME}`` and ``${NAME:-default}`` in settings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

_REFERENCE = re.compile(r"\$\$(?=\{)|\$\{([^}]*)(\}?)")
_BODY = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)(?::-(.*))?", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Expansion:
    """A text with environment variables expanded.

    ``shown`` has ``${NAME}`` instead of values and may be published; ``filled`` maps each value to its ``${NAME}``.
    """

    value: str
    shown: str
    filled: Mapping[str, str]
    mistakes: tuple[str, ...]


def expand(text: str, environ: Mapping[str, str]) -> Expansion:
    """Expand variables; a default replaces a variable that is unset or empty; ``$${`` is a literal ``${``."""
    filled: dict[str, str] = {}
    mistakes: list[str] = []

    def fill(match: re.Match[str]) -> str:
        if match[0] == "$$":
            return "$"
        try:
            found = _value(match, environ)
        except ValueError as error:
            mistakes.append(str(error))
            found = ""
        filled[found] = _name(match)
        return found

    return Expansion(_REFERENCE.sub(fill, text), _REFERENCE.sub(_name, text), filled, tuple(mistakes))


def _name(match: re.Match[str]) -> str:
    if match[0] == "$$":
        return "$"
    parts = _BODY.fullmatch(match[1]) if match[2] else None
    return f"${{{parts[1] if parts else '…'}}}"


def _value(match: re.Match[str], environ: Mapping[str, str]) -> str:
    """Value of a reference. Raises ``ValueError`` if it is malformed or its variable is unset."""
    body, closed = match[1], match[2]
    if not closed:
        raise ValueError("'${' is never closed; expected '${NAME}' ('$${' stands for '${' itself)")
    if (parts := _BODY.fullmatch(body)) is None:
        raise ValueError(f"'${{{body}}}' names no variable; expected '${{NAME}}' or '${{NAME:-default}}'")
    name, default = parts[1], parts[2]
    if default is not None:
        return environ.get(name) or str(default)
    if name not in environ:
        raise ValueError(f"environment variable {name} is not set; set it or write '${{{name}:-default}}'")
    return environ[name]
