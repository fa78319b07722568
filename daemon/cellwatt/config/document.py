"""A YAML file as plain values, with the place of each.

Scalars are read by the YAML 1.2 core schema, so ``on``, ``no``, ``12:30`` and ``0123`` are the text they
look like. Anchors, aliases and merge keys (``<<``) work; duplicate keys and unknown tags are mistakes.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import yaml

from cellwatt.config.environment import expand
from cellwatt.config.places import KeyPath, Mark, Place, dotted
from cellwatt.errors import ConfigError, Problem

LARGEST_FILE = 1_000_000  # bytes
LARGEST_TREE = 100_000
"""Values in a file after aliases and merges are followed; a few nested ones can stand for billions."""

_SHORTEST_SECRET = 4
"""Characters from which on a value from the environment is blanked in messages."""

_TAG = "tag:yaml.org,2002:"


class WrittenFloat(float):
    """A number as it stands in the file, so that quantities can tell it from a default in base units."""

    __slots__ = ()


class _Loader(yaml.SafeLoader):
    """YAML 1.2 core schema instead of PyYAML's 1.1."""

    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}  # type: ignore[misc]  # the stub says instance


for _name, _pattern, _first in (
    ("null", r"null|Null|NULL|~|", ("n", "N", "~", "")),
    ("bool", r"true|True|TRUE|false|False|FALSE", tuple("tTfF")),
    ("int", r"[-+]?(?:0|[1-9][0-9]*)|0x[0-9a-fA-F]+|0o[0-7]+", tuple("-+0123456789")),
    (
        "float",
        r"[-+]?(?:\.[0-9]+|(?:0|[1-9][0-9]*)(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        tuple("-+.0123456789"),
    ),
    ("merge", r"<<", ("<",)),
):
    _Loader.add_implicit_resolver(f"{_TAG}{_name}", re.compile(rf"(?:{_pattern})\Z"), list(_first))


@dataclass(frozen=True, slots=True)
class Document:
    """A file's values; the places of all keys; what came from the environment; mistakes of form."""

    file: Path
    text: str
    value: Any
    places: Mapping[KeyPath, Place]
    environment: Mapping[KeyPath, str]
    secrets: Mapping[str, str]
    mistakes: Mapping[KeyPath, tuple[Problem, ...]]

    def problem(self, path: KeyPath, message: str, *, at_key: bool = False) -> Problem:
        """A mistake at a value, or at its key; for settings and for a key that is not there, at the nearest key.

        Values that came from the environment are shown as ``${NAME}``.
        """
        there = path
        while there and there not in self.places:
            there, at_key = there[:-1], True
        for value, shown in self.secrets.items():
            message = message.replace(value, shown) if len(value) >= _SHORTEST_SECRET else message
        place, at_key = self.places[there], at_key or isinstance(self.at(there), dict)
        return Problem(_place(self.file, place.key if at_key else place.value), dotted(path), message)

    def place(self, path: KeyPath) -> str:
        """``file:line:column`` of a key."""
        return _place(self.file, self.places[path].key)

    def at(self, path: KeyPath) -> Any:
        """The value at a path that is in ``places``."""
        value = self.value
        for part in path:
            value = value[part]
        return value


def read(file: Path, environ: Mapping[str, str] = os.environ) -> Document:
    """Read a settings file. Raises ``ConfigError`` where it cannot be read or is not YAML with keys at the top."""
    text = _text(file)
    try:
        node = yaml.compose(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise ConfigError([_syntax(file, text, error)]) from error
    except RecursionError as error:
        raise ConfigError([Problem(_place(file, Mark(1, 1)), "", "not valid YAML: nested too deeply")]) from error
    builder = _Builder(file, environ)
    if node is None:
        raise ConfigError([Problem(_place(file, Mark(1, 1)), "", "the file is empty; expected site, cell and sources")])
    mark = _mark(node)
    if not isinstance(node, yaml.MappingNode):
        found = "a list" if isinstance(node, yaml.SequenceNode) else "a single value"
        message = f"found {found}, expected settings (key: value) starting with site, cell and sources"
        raise ConfigError([Problem(_place(file, mark), "", message)])
    value = builder.build(node, (), mark)
    mistakes = {path: tuple(found) for path, found in builder.mistakes.items()}
    secrets = dict(sorted(builder.secrets.items(), key=lambda item: -len(item[0])))  # the longer holds the shorter
    return Document(file, text, value, builder.places, builder.environment, secrets, mistakes)


def _text(file: Path) -> str:
    try:
        with file.open("rb") as stream:
            content = stream.read(LARGEST_FILE + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise ConfigError([Problem(str(file), "", f"cannot be read: {reason.lower()}")]) from error
    if len(content) > LARGEST_FILE:
        raise ConfigError([Problem(str(file), "", f"larger than {LARGEST_FILE:,} bytes: this is no settings file")])
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line_start = content.rfind(b"\n", 0, error.start) + 1
        column = len(content[line_start : error.start].decode("utf-8", "replace")) + 1
        mark = Mark(content.count(b"\n", 0, error.start) + 1, column)
        byte = content[error.start]
        message = f"not UTF-8 text (byte 0x{byte:02x}); save the file as UTF-8"
        raise ConfigError([Problem(_place(file, mark), "", message)]) from error


_ADVICE = (
    ("\\t", "a tab; indent with spaces"),
    ("mapping values are not allowed", "check the indentation; a value that holds ': ' needs quotes"),
    ("could not find expected ':'", "expected 'key: value'"),
    ("but found another document", "a second document ('---'); expected one cell a file"),
    ("expected <block end>", "check the indentation of this line"),
    ("cannot start any token", "a value that starts with this character needs quotes"),
    ("found undefined alias", "an alias (*name) needs its anchor (&name) further up"),
    ("found unknown escape character", "write a backslash in 'single quotes'"),
)


def _syntax(file: Path, text: str, error: yaml.YAMLError) -> Problem:
    if isinstance(error, yaml.reader.ReaderError):
        before = text[: error.position]
        mark = Mark(before.count("\n") + 1, error.position - before.rfind("\n"))
        message = f"not valid YAML: character U+{ord(text[error.position]):04X} is not allowed"
        return Problem(_place(file, mark), "", message)
    if not isinstance(error, yaml.MarkedYAMLError) or error.problem_mark is None:
        return Problem(_place(file, Mark(1, 1)), "", f"not valid YAML: {' '.join(str(error).split())}")
    what = " ".join(part for part in (error.problem, error.context) if part)
    advice = next((advice for sign, advice in _ADVICE if sign in what), None)
    mark = Mark(error.problem_mark.line + 1, error.problem_mark.column + 1)
    hint = f" ({advice})" if advice else ""
    return Problem(_place(file, mark), "", f"not valid YAML: {' '.join((error.problem or what).split())}{hint}")


def _mark(node: yaml.Node) -> Mark:
    return Mark(node.start_mark.line + 1, node.start_mark.column + 1)


def _place(file: Path, mark: Mark) -> str:
    return f"{file}:{mark.line}:{mark.column}"


class _Builder:
    """Turns nodes into values and notes their places, environment and mistakes."""

    def __init__(self, file: Path, environ: Mapping[str, str]) -> None:
        self.file = file
        self.environ = environ
        self.places: dict[KeyPath, Place] = {}
        self.environment: dict[KeyPath, str] = {}
        self.secrets: dict[str, str] = {}
        self.mistakes: dict[KeyPath, list[Problem]] = {}
        self._open: set[int] = set()
        self._merges = 0

    def build(self, node: yaml.Node, path: KeyPath, key: Mark) -> Any:
        written = str(node.value) if isinstance(node, yaml.ScalarNode) else ""
        self.places[path] = Place(key, _mark(node), written)
        self._limit(len(self.places), node, path)
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, path)
        if id(node) in self._open:
            return self._mistake(path, _mark(node), "an anchor that contains itself")
        self._open.add(id(node))
        try:
            if isinstance(node, yaml.MappingNode):
                return self._mapping(node, path)
            return [self.build(child, (*path, i), _mark(child)) for i, child in enumerate(node.value)]
        finally:
            self._open.discard(id(node))

    def _mapping(self, node: yaml.MappingNode, path: KeyPath) -> dict[Any, Any]:
        entries: dict[Any, tuple[yaml.Node, yaml.Node]] = {}
        for key_node, value_node in self._pairs(node, path):
            key = self._key(key_node, path)
            if key is None:
                continue
            if key in entries:
                first = _mark(entries[key][0])
                message = f"the key {key!r} is given twice, first at line {first.line} column {first.column}"
                self._mistake((*path, key), _mark(key_node), message)
            else:
                entries[key] = key_node, value_node
        for key_node, value_node in self._merged(node, path):
            key = self._key(key_node, path)
            if key is not None:
                entries.setdefault(key, (key_node, value_node))
        return {key: self.build(value, (*path, key), _mark(name)) for key, (name, value) in entries.items()}

    def _pairs(self, node: yaml.MappingNode, path: KeyPath) -> list[tuple[yaml.Node, yaml.Node]]:
        if node.tag != f"{_TAG}map":
            self._mistake(path, _mark(node), f"the tag {_short(node.tag)} means nothing here")
        return [(k, v) for k, v in node.value if k.tag != f"{_TAG}merge"]

    def _merged(self, node: yaml.MappingNode, path: KeyPath) -> list[tuple[yaml.Node, yaml.Node]]:
        """Pairs that ``<<`` brings in, nearest first."""
        found: list[tuple[yaml.Node, yaml.Node]] = []
        for key, value in node.value:
            if key.tag != f"{_TAG}merge":
                continue
            for origin in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                if not isinstance(origin, yaml.MappingNode) or id(origin) in self._open:
                    self._mistake(path, _mark(key), "'<<' expects *name of settings (key: value) further up")
                    continue
                self._merges += len(origin.value)
                self._limit(self._merges, key, path)
                self._open.add(id(origin))
                found += self._pairs(origin, path) + self._merged(origin, path)
                self._open.discard(id(origin))
        return found

    def _key(self, node: yaml.Node, path: KeyPath) -> str | int | None:
        key = self._plain(node, path) if isinstance(node, yaml.ScalarNode) else None
        if isinstance(key, str) or type(key) is int:
            return key
        what = f"{node.value!r}" if isinstance(node, yaml.ScalarNode) else "a list or mapping"
        quoted = f'; write it in quotes: "{node.value}"' if isinstance(node, yaml.ScalarNode) else ""
        self._mistake(path, _mark(node), f"found {what} as a key, expected a name{quoted}")
        return None

    def _scalar(self, node: yaml.ScalarNode, path: KeyPath) -> Any:
        value = self._plain(node, path)
        if not isinstance(value, str) or "${" not in value:
            return value
        expansion = expand(value, self.environ)
        for mistake in expansion.mistakes:
            self._mistake(path, _mark(node), mistake)
        if expansion.filled:
            self.environment[path] = expansion.shown
            self.secrets.update(expansion.filled)
        return None if expansion.mistakes else expansion.value

    def _plain(self, node: yaml.ScalarNode, path: KeyPath) -> str | int | float | bool | None:
        text: str = node.value
        try:
            match node.tag.removeprefix(_TAG):
                case "str" | "merge":
                    return text
                case "null":
                    return None
                case "bool":
                    return {"true": True, "false": False}[text.lower()]
                case "int":
                    return int(text, 0)
                case "float":
                    return self._float(text, node, path)
        except (ValueError, KeyError):
            self._mistake(path, _mark(node), f"{text[:40]!r} cannot be read as {_short(node.tag)}")
            return None
        self._mistake(path, _mark(node), f"the tag {_short(node.tag)} means nothing here")
        return None

    def _float(self, text: str, node: yaml.ScalarNode, path: KeyPath) -> float | None:
        number = WrittenFloat(re.sub(r"\.(?=inf|nan)", "", text, flags=re.IGNORECASE))
        if math.isfinite(number):
            return number
        self._mistake(path, _mark(node), f"found {text[:40]}, expected a finite number")
        return None

    def _limit(self, count: int, node: yaml.Node, path: KeyPath) -> None:
        if count > LARGEST_TREE:
            message = f"the aliases stand for more than {LARGEST_TREE:,} values"
            raise ConfigError([Problem(_place(self.file, _mark(node)), dotted(path), message)])

    def _mistake(self, path: KeyPath, mark: Mark, message: str) -> None:
        self.mistakes.setdefault(path, []).append(Problem(_place(self.file, mark), dotted(path), message))


def _short(tag: str) -> str:
    return tag.replace(_TAG, "!!")
