"""A settings file as YAML nodes, and its syntax errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import yaml

from cellwatt.config.places import NOWHERE, KeyPath, Mark, dotted
from cellwatt.errors import ConfigError, Problem
from cellwatt.files import read_bytes
from cellwatt.host import blank
from cellwatt.yaml_file import Loader, TooMuchError, check_bounds

LARGEST = 1_000_000
"""Largest size, bytes, of a settings file."""
MOST_VALUES = 20_000
"""Largest number of values of a settings file, after aliases and merges are expanded."""
LONGEST = 1_000
"""Largest length, characters, of a message, and of the key path before it."""
LONGEST_VALUE = 60
"""Largest length, characters, of a key or value quoted in a message."""


class _Loader(yaml.SafeLoader):
    """The same schema with the slower parser, whose error messages are more detailed."""

    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = Loader.yaml_implicit_resolvers  # type: ignore[misc]


def compose(file: Path, text: str, expected: str) -> yaml.Node:
    """Root node of a file's text; ``expected`` names the keys that the file should have.

    Raises ``ConfigError`` if the file is empty or not YAML.
    """
    try:
        check_bounds(text, MOST_VALUES, _Loader)
        node = yaml.compose(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise ConfigError([_syntax(file, text, error)]) from error
    if node is None:
        raise ConfigError([problem(file, Mark(1, 1), f"the file is empty; expected {expected}")])
    return node


def mark_of(node: yaml.Node) -> Mark:
    """Position at which a node starts."""
    return Mark(node.start_mark.line + 1, node.start_mark.column + 1)


def problem(file: Path, mark: Mark, message: str, path: KeyPath = ()) -> Problem:
    """A problem at a position."""
    return Problem(place(file, mark), shortened(blank(dotted(path))), shortened(blank(message)))


def shortened(text: str, longest: int = LONGEST) -> str:
    """A text cut to ``longest`` characters, as a hostile file may contain long ones."""
    return text if len(text) <= longest else f"{text[:longest]}…"


def quoted(value: object) -> str:
    """A key or value, quoted for a message."""
    return shortened(blank(repr(value)), LONGEST_VALUE)


def place(file: Path, mark: Mark) -> str:
    """``file:line:column``, or the file alone without a position."""
    return f"{file}:{mark.line}:{mark.column}" if mark != NOWHERE else str(file)


def text_of(file: Path, largest: int = LARGEST) -> str:
    """Text of a file of at most ``largest`` bytes. Raises ``ConfigError`` if it cannot be read or is not UTF-8."""
    try:
        content = read_bytes(file, largest)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise ConfigError([Problem(str(file), "", f"cannot be read: {reason[:1].lower()}{reason[1:]}")]) from error
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line_start = content.rfind(b"\n", 0, error.start) + 1
        column = len(content[line_start : error.start].decode("utf-8", "replace")) + 1
        mark = Mark(content.count(b"\n", 0, error.start) + 1, column)
        byte = content[error.start]
        message = f"not UTF-8 text (byte 0x{byte:02x}); save the file as UTF-8"
        raise ConfigError([problem(file, mark, message)]) from error


_ADVICE = (
    ("\\t", "a tab; indent with spaces"),
    ("mapping values are not allowed", "check the indentation; a value that holds ': ' needs quotes"),
    ("could not find expected ':'", "expected 'key: value'"),
    ("but got '{'", 'within { }, ${NAME} needs quotes: "${NAME}"'),
    ("but found another document", "a second document ('---'); expected one cell a file"),
    ("expected <block end>", "check the indentation of this line"),
    ("cannot start any token", "a value that starts with this character needs quotes"),
    ("expected alphabetic or numeric character", "a value with * or & needs quotes, like '*'"),
    ("found undefined alias", "an alias (*name) needs its anchor (&name) further up"),
    ("found unknown escape character", "write a backslash in 'single quotes'"),
)


def _character(file: Path, text: str, at: int, why: str) -> Problem:
    before = text[:at]
    mark = Mark(before.count("\n") + 1, at - before.rfind("\n"))
    return problem(file, mark, f"not valid YAML: character U+{ord(text[at]):04X} {why}")


def _syntax(file: Path, text: str, error: yaml.YAMLError) -> Problem:
    if isinstance(error, yaml.reader.ReaderError):
        return _character(file, text, error.position, "is not allowed")
    if not isinstance(error, yaml.MarkedYAMLError) or error.problem_mark is None:
        return problem(file, Mark(1, 1), f"not valid YAML: {' '.join(str(error).split())}")
    end = error.problem_mark.index
    if (at := text.rfind("\u00a0", text.rfind("\n", 0, max(0, text.rfind("\n", 0, end))) + 1, end + 1)) >= 0:
        return _character(file, text, at, "is no space to YAML: write a plain one")
    mark = Mark(error.problem_mark.line + 1, error.problem_mark.column + 1)
    if isinstance(error, TooMuchError):
        return problem(file, mark, f"{error.problem}: this is no settings file")
    what = " ".join(part for part in (error.problem, error.context) if part)
    advice = next((advice for sign, advice in _ADVICE if sign in what), None)
    hint = f" ({advice})" if advice else ""
    began = error.context_mark
    if "flow" in what and began is not None and began.line < error.problem_mark.line:
        hint += f"; the bracket of line {began.line + 1} column {began.column + 1} is still open"
    return problem(file, mark, f"not valid YAML: {' '.join((error.problem or what).split())}{hint}")
