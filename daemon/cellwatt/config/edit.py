"""Changes of a settings file in place: single values, with all else and every comment left as it stands."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import yaml

from cellwatt.config.document import Document
from cellwatt.config.places import KeyPath

_AHEAD = re.compile(r"(?:[&!]\S*\s+|#[^\n]*\s+)*")
"""Anchor, tag and comments in front of the first key."""


def edited(document: Document, changes: Mapping[KeyPath, Any]) -> str:
    """The text of a settings file with changed or added values, each a number, a text, true or false.

    A value that a mapping has from elsewhere by ``<<`` is not changed there: the key is added, which overrides it.
    """
    edits: list[tuple[int, int, str]] = []
    added: dict[KeyPath, list[str]] = {}
    for path, value in changes.items():
        if not _is_own(document, path):
            added.setdefault(path[:-1], []).append(f"{path[-1]}: {_scalar(value)}")
        elif document.at(path) != value:
            start, end = document.places[path].span
            written = document.text[start:end]
            edits.append((start, end, _scalar(value) + written[len(written.rstrip()) :]))
    for path, lines in added.items():
        at, between = _room(document, path)
        edits.append((at, at, "".join(line + between for line in lines)))
    text = document.text
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def _is_own(document: Document, path: KeyPath) -> bool:
    """True where a value stands within the mapping that has it."""
    if path not in document.places:
        return False
    start, end = document.places[path[:-1]].span
    return start <= document.places[path].span[0] < end


def _room(document: Document, path: KeyPath) -> tuple[int, str]:
    """Where a mapping has room for further keys at its front, and what stands after each of them."""
    start, end = document.places[path].span
    ahead = _AHEAD.match(document.text[start:end])
    first = start + (ahead.end() if ahead else 0)
    if document.text[first] == "{":
        return first + 1, ", "
    return first, "\n" + " " * (first - document.text.rfind("\n", 0, first) - 1)


def _scalar(value: Any) -> str:
    """A value as YAML writes it within a list in brackets, which is right everywhere."""
    listed: str = yaml.safe_dump([value], default_flow_style=True, width=float("inf"), allow_unicode=True)
    return listed.strip()[1:-1]
