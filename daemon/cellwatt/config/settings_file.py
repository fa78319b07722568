"""Any file that a person writes or a command wrote, checked as the settings of a cell are.

Every mistake is told with file, line and column, what was found, what was expected, and the nearest key that is known.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import AfterValidator, TypeAdapter, ValidationError

from cellwatt.config.document import Document, read
from cellwatt.config.fields import fields_at
from cellwatt.config.marks import COMPUTED_FILE, SETTINGS_FILE
from cellwatt.config.places import KeyPath, first
from cellwatt.config.secret import secrets_in
from cellwatt.config.wording import explain, unknown_key
from cellwatt.errors import CellwattError, ConfigError, Problem
from cellwatt.files import COMPUTED, read_text
from cellwatt.yaml_file import parse_yaml

T = TypeVar("T")
Check = Callable[[T], Iterable[tuple[KeyPath, str]]]
"""Finds what types cannot say: where a mistake is, and what was found and expected."""

ALIKE: Final = 0.8
"""Share of a key that it has in common with a known one, from which on it is taken for that, misspelt."""


def reads_version(number: int, advice: str) -> AfterValidator:
    """Validator of the key that states a format: any other than ``number`` is refused with the advice."""

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

    ``computed``: a command wrote it, so that it may be large. Raises ``refusal`` with the mistakes found, in order.
    """
    adapter: TypeAdapter[T] = TypeAdapter(kind)
    if computed and (made := _at_once(path, adapter, check)) is not None:
        return made
    try:
        return _placed(path, adapter, kind, check, computed)
    except ConfigError as error:
        if issubclass(refusal, ConfigError):
            raise
        more = len(error.problems) - 1
        raise refusal(f"{error.problems[0]}{f' (and {more} more)' if more else ''}") from error


def _at_once(path: Path, adapter: TypeAdapter[T], check: Check[T] | None) -> T | None:
    """Content without the place of each value, which takes long to find; None where anything is wrong."""
    try:
        text = read_text(path, COMPUTED)
        made = adapter.validate_python(json.loads(text) if path.suffix == ".json" else parse_yaml(text))
    except (OSError, ValueError, RecursionError):
        return None
    return None if check is not None and any(True for _ in check(made)) else made


def _placed(path: Path, adapter: TypeAdapter[T], kind: Any, check: Check[T] | None, computed: bool) -> T:
    keys = ", ".join(name for name, field in fields_at(kind, ()).items() if field.is_required())
    document = read(path, {}, bounds=COMPUTED_FILE if computed else SETTINGS_FILE, expected=keys)
    for secret in secrets_in(kind, document.value):
        document.hide(secret)
    mistakes = [problem for found in document.mistakes.values() for problem in found]
    try:
        made = adapter.validate_python(document.value)
    except ValidationError as error:
        told = explain(error, kind, document, (), set(document.mistakes))
        raise ConfigError(first([*mistakes, *told])) from error
    mistakes += _misspelt(document, kind)
    mistakes += [document.problem(place, message) for place, message in (check(made) if check is not None else ())]
    if mistakes:
        raise ConfigError(first(mistakes))
    return made


def _misspelt(document: Document, kind: Any) -> Iterator[Problem]:
    """Keys that ``kind`` passes over, and that are nearly one that it knows and that is not there."""
    for path in document.places:
        if not path or not isinstance(path[-1], str):
            continue
        fields, beside = fields_at(kind, path[:-1]), document.at(path[:-1])
        absent = [key for key in fields if key not in beside]
        if path[-1] not in fields and difflib.get_close_matches(path[-1], absent, 1, ALIKE):
            yield document.problem(path, unknown_key(path[-1], list(fields)), at_key=True)
