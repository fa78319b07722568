"""Versions of the settings file, and the edits that bring an older one up to date.

Version 0 is the form until cellwatt 0.1.0. A file that states none is read as the newest version: nothing is changed
in it unasked. A migration gives edits of the text, so that comments and order stay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from pydantic import ValidationError

from cellwatt.config.document import Document, parse, read
from cellwatt.config.places import KeyPath, Mark
from cellwatt.errors import ConfigError
from cellwatt.registry import outlet

KEY: Final = "version"


class Edit(NamedTuple):
    """Characters ``start`` to ``end`` of the text that are replaced."""

    start: int
    end: int
    text: str


Migration = Callable[[Document], Sequence[Edit]]


def stated(document: Document) -> int:
    """The version that a file states, else the newest. Raises ``ConfigError`` if it is newer than this cellwatt."""
    version = document.value.get(KEY)
    if type(version) is not int or version < 0:  # absent, or a mistake that loading tells
        return NEWEST
    if version > NEWEST:
        message = (
            f"settings of version {version}, this cellwatt reads up to version {NEWEST}: "
            "install the cellwatt that they were written for, or a later one"
        )
        raise ConfigError([document.problem((KEY,), message)])
    return version


def migrated(document: Document, version: int) -> str:
    """Text of a settings file of ``version`` in the form of the newest, which it then states."""
    for number in range(version, NEWEST):
        edits = [*MIGRATIONS[number](document), _version(document, number + 1)]
        text = document.text
        for edit in sorted(edits, reverse=True):
            text = text[: edit.start] + edit.text + text[edit.end :]
        document = parse(document.file, text, document.environ)
    return document.text if KEY in document.value else _applied(document, _version(document, NEWEST))


def read_newest(file: Path, environ: Mapping[str, str]) -> tuple[Document, tuple[str, ...]]:
    """A settings file in the newest form, whatever version it states, and a warning where it was an older one.

    Raises ``ConfigError`` where it cannot be read, or is newer than this cellwatt.
    """
    document = read(file, environ)
    version = stated(document)
    if version == NEWEST:
        return document, ()
    warning = f"settings of version {version} are read as version {NEWEST}: cellwatt migrate {file} shows the changes"
    return parse(file, migrated(document, version), environ), (warning,)


def _applied(document: Document, edit: Edit) -> str:
    return document.text[: edit.start] + edit.text + document.text[edit.end :]


def _version(document: Document, number: int) -> Edit:
    place = document.places.get((KEY,))
    return _first(document, (), f"{KEY}: {number}") if place is None else Edit(*place.span, str(number))


def _first(document: Document, path: KeyPath, entry: str) -> Edit:
    """Put ``key: value`` in front of the first key of the mapping at ``path``, in its style; an empty one is filled."""
    start, end = document.places[path].span
    below = document.at(path)
    if not below:
        return Edit(start, end, f" {{{entry}}}" if start == end else f"{{{entry}}}")
    starts = (_index(document.text, document.places[(*path, key)].key) for key in below)
    at = min(index for index in starts if start <= index < end)
    if "{" in document.text[start:at]:
        return Edit(at, at, f"{entry}, ")
    indent = at - (document.text.rfind("\n", 0, at) + 1)
    return Edit(at, at, f"{entry}\n{' ' * indent}")


def _index(text: str, mark: Mark) -> int:
    return sum(map(len, text.splitlines(keepends=True)[: mark.line - 1])) + mark.column - 1


def _open_to_the_network(document: Document) -> Iterator[Edit]:
    """Until 0.1.0 a cell that listened beyond its PC was open; since then it has to say so."""
    values = document.value.get("zenoh")
    if not isinstance(values, dict) or "open" in values:
        return
    settings = outlet("zenoh").Settings
    try:
        settings.model_validate(values)
    except ValidationError:
        try:
            settings.model_validate({**values, "open": True})
        except ValidationError:
            return  # something else is wrong
        yield _first(document, ("zenoh",), "open: true")


MIGRATIONS: Final[tuple[Migration, ...]] = (lambda document: tuple(_open_to_the_network(document)),)
"""From version 0 to 1, from 1 to 2 …"""
NEWEST: Final = len(MIGRATIONS)
