"""``${NAME}`` and ``${NAME:-default}`` in settings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

_REFERENCE = re.compile(r"\$\$(?=\{)|\$\{([^}]*)(\}?)")
_BODY = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)(?::-(.*))?", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Expansion:
    """A text with the environment filled in.

    ``shown`` has ``${NAME}`` instead and may be published; ``filled`` maps what was put in to its ``${NAME}``.
    """

    value: str
    shown: str
    filled: Mapping[str, str]
    mistakes: tuple[str, ...]


def expand(text: str, environ: Mapping[str, str]) -> Expansion:
    """Fill in variables; a default counts where the variable is unset or empty, ``$${`` stands for ``${``."""
    value, shown, end = list[str](), list[str](), 0
    filled: dict[str, str] = {}
    mistakes: list[str] = []
    for match in _REFERENCE.finditer(text):
        between = text[end : match.start()]
        end = match.end()
        if match[0] == "$$":
            value.append(f"{between}$")
            shown.append(f"{between}$")
            continue
        found, name = _lookup(match, environ, mistakes)
        filled[found] = f"${{{name}}}"
        value.append(f"{between}{found}")
        shown.append(f"{between}${{{name}}}")
    rest = text[end:]
    return Expansion("".join(value) + rest, "".join(shown) + rest, filled, tuple(mistakes))


def _lookup(match: re.Match[str], environ: Mapping[str, str], mistakes: list[str]) -> tuple[str, str]:
    body, closed = match[1], match[2]
    if not closed:
        mistakes.append("'${' is never closed; expected '${NAME}' ('$${' stands for '${' itself)")
        return "", "…"
    parts = _BODY.fullmatch(body)
    if parts is None:
        mistakes.append(f"'${{{body}}}' names no variable; expected '${{NAME}}' or '${{NAME:-default}}'")
        return "", "…"
    name, default = parts[1], parts[2]
    found = environ.get(name)
    if default is not None:
        return found or default, name
    if found is None:
        mistakes.append(f"environment variable {name} is not set; set it or write '${{{name}:-default}}'")
    return found or "", name
