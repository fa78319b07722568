"""Reads any other file, written by a person or by a command, with the checks of a cell's settings.

Every problem is reported with file, line and column (in a file that a command wrote: file and key), the value found,
the value expected, and the nearest known key.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import AfterValidator, TypeAdapter, ValidationError

from cellwatt.config.document import Document, read, read_computed, without_positions
from cellwatt.config.fields import fields_at
from cellwatt.config.places import KeyPath, first
from cellwatt.config.secret import secrets_in
from cellwatt.config.wording import explain, unknown_key
from cellwatt.errors import CellwattError, ConfigError, Problem
from cellwatt.section import Section

T = TypeVar("T")
Check = Callable[[T], Iterable[tuple[KeyPath, str]]]
"""Finds errors that types cannot express: yields key path and message (value found, value expected)."""

ALIKE: Final = 0.8
"""Smallest similarity (difflib ratio) at which an unknown key counts as a misspelt known key."""


def reads_version(number: int, advice: str) -> AfterValidator:
    """Validator of the key with the format version: any version but ``number`` is refused with ``advice``."""

    def check(found: int) -> int:
        if found != number:
            raise ValueError(f"this cellwatt reads version {number}: {advice}")
        return found

    return AfterValidator(check)


def read_settings(
    path: Path,
    kind: type[T],
    check: Check[T] | None = None,
    *,
    refusal: type[CellwattError] = ConfigError,
    computed: bool = False,
) -> T:
    """Content of a YAML or JSON file as ``kind``: a settings class, a dataclass, or a mapping of them.

    ``computed``: a command wrote the file, so it may be large. Raises ``refusal`` with the problems, in file order.
    """
    try:
        return _checked(path, kind, check, computed)
    except ConfigError as error:
        if issubclass(refusal, ConfigError):
            raise
        more = len(error.problems) - 1
        raise refusal(f"{error.problems[0]}{f' (and {more} more)' if more else ''}") from error


def _checked(path: Path, kind: Any, check: Check[T] | None, computed: bool) -> T:
    adapter: TypeAdapter[T] = TypeAdapter(kind)
    fields = fields_at(kind, ())
    expected = ", ".join([name for name, field in fields.items() if field.is_required()] or fields)
    document = read_computed(path, expected) if computed else read(path, {}, expected=expected)
    for secret in secrets_in(kind, document.value):
        document.hide(secret)
    mistakes = [problem for found in document.mistakes.values() for problem in found]
    try:
        made = adapter.validate_python(document.value)
    except ValidationError as error:
        if computed:
            document.places.update(without_positions(document.value))
        invalid = explain(error, kind, document, (), set(document.mistakes))
        raise ConfigError(first([*mistakes, *invalid])) from error
    mistakes += _misspelt(document, kind)
    mistakes += [document.problem(place, message) for place, message in (check(made) if check is not None else ())]
    if mistakes:
        raise ConfigError(first(mistakes))
    return made


def _misspelt(document: Document, kind: Any) -> Iterator[Problem]:
    """Problems for keys that ``kind`` ignores and that resemble a known key."""
    if isinstance(kind, type) and issubclass(kind, Section):
        return  # ignores none
    for path in document.places:
        if not path or not isinstance(path[-1], str):
            continue
        fields = fields_at(kind, path[:-1])
        if path[-1] not in fields and difflib.get_close_matches(path[-1], fields, 1, ALIKE):
            yield document.problem(path, unknown_key(path[-1], list(fields)), at_key=True)
