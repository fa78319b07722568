"""A YAML file as plain values, with the position of each value; a file that a command wrote, without positions.

Scalars are read by the YAML 1.2 core schema, so ``on``, ``no``, ``12:30`` and ``0123`` are text. Anchors, aliases and
merge keys (``<<``) work; duplicate keys and unknown tags are errors.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from cellwatt.config.environment import expand
from cellwatt.config.marks import LONGEST, compose, mark_of, place, problem, quoted, shortened, text_of
from cellwatt.config.places import NOWHERE, KeyPath, Location, Mark
from cellwatt.errors import ConfigError, Problem
from cellwatt.files import COMPUTED
from cellwatt.host import HIDDEN, blank, secrets_of, without
from cellwatt.yaml_file import TAG, parse_yaml

_REFERENCE = re.compile(r"\$\{[A-Za-z_][A-Za-z0-9_]*\}")
_PROPERTIES = re.compile(r"(?:[&!]\S*\s+)*")
"""Anchor and tag before a value."""
_COMMENT = re.compile(r"(?<!\S)#.*")
_CERTAIN_SECRET = 8
"""Shortest length, characters, of a secret that is also hidden in comments and other values."""


class WrittenFloat(float):
    """A number read from the file; the type distinguishes it from a default, which is in base units."""

    __slots__ = ()


@dataclass(slots=True)
class Document:
    """Values of a file, positions of all keys, values from the environment, and syntax errors."""

    file: Path
    text: str
    value: Any = None
    places: dict[KeyPath, Location] = field(default_factory=dict)
    environment: dict[KeyPath, str] = field(default_factory=dict)
    secrets: dict[str, str] = field(default_factory=dict)
    mistakes: dict[KeyPath, list[Problem]] = field(default_factory=dict)

    def problem(self, path: KeyPath, message: str, *, at_key: bool = False) -> Problem:
        """A problem at a value or at its key; for a mapping, at its key; for a missing key, at the nearest parent key.

        Values from the environment are shown as ``${NAME}``.
        """
        nearest = self._nearest(path)
        message = self.blanked(message)
        at_key = at_key or nearest != path or isinstance(self.at(nearest), dict)
        found = self.places[nearest]
        return problem(self.file, found.key if at_key else found.value, message, path)

    def blanked(self, message: str) -> str:
        """A message with secrets and values from the environment replaced."""
        return without(shortened(message, 20 * LONGEST), self.secrets)

    def hide(self, path: KeyPath) -> None:
        """Mark the value at a path as secret: it is hidden in all texts, unless it is written as ``${NAME}`` alone."""
        location = self.places.get(path)
        if location is None or not location.written:
            return
        if not _REFERENCE.fullmatch(location.written):
            self.environment[path] = HIDDEN
            value = self.at(path)
            self.secrets.update({str(text): HIDDEN for text in (location.written, value) if text is not None})

    @property
    def public_text(self) -> str:
        """The text of the file, valid YAML, with secrets hidden.

        A secret is also hidden in other values and in comments; keys and anchors of the same text are unchanged.
        """
        hidden = [self.places[path] for path, shown in self.environment.items() if shown == HIDDEN]
        certain = {place.written for place in hidden if len(place.written) >= _CERTAIN_SECRET}
        secret = re.compile("|".join(map(re.escape, sorted(certain, key=len, reverse=True))) or "(?!)")
        shown = {place.span: secret.sub(HIDDEN, place.written) for place in self.places.values() if place.written}
        shown |= {place.span: HIDDEN for place in hidden}

        def between(start: int, end: int) -> str:
            return _COMMENT.sub(lambda found: secret.sub(HIDDEN, found[0]), self.text[start:end])

        pieces, at = list[str](), 0
        for (start, end), value in sorted(shown.items()):
            written = self.text[start:end]
            pieces += [between(at, start), _with_value(written, value) if HIDDEN in value else written]
            at = end
        return blank("".join([*pieces, between(at, len(self.text))]))

    def place(self, path: KeyPath) -> str:
        """``file:line:column`` of a key, or of its nearest parent in the file."""
        return place(self.file, self.places[self._nearest(path)].key)

    def _nearest(self, path: KeyPath) -> KeyPath:
        while path and path not in self.places:
            path = path[:-1]
        return path

    def at(self, path: KeyPath) -> Any:
        """The value at a path; the path must be in ``places``."""
        value = self.value
        for part in path:
            value = value[part]
        return value


def read(
    file: Path,
    environ: Mapping[str, str],
    *,
    text: str | None = None,
    expected: str = "site, cell and sources",
) -> Document:
    """Read a settings file, or ``text`` as its content; ``expected`` names the keys that the file should have.

    Raises ``ConfigError`` if the file cannot be read or is not a YAML mapping.
    """
    text = text_of(file) if text is None else text
    node = compose(file, text, expected)
    if not isinstance(node, yaml.MappingNode):
        found = "a list" if isinstance(node, yaml.SequenceNode) else "a single value"
        message = f"found {found}, expected settings (key: value) starting with {expected}"
        raise ConfigError([problem(file, mark_of(node), message)])
    document = Document(file, text)
    document.value = _Builder(document, environ).build(node, (), mark_of(node))
    return document


def read_computed(file: Path, expected: str) -> Document:
    """Read a JSON or YAML file that a command wrote: it may be large, and its values have no positions.

    Raises ``ConfigError`` if the file cannot be read or is not a mapping.
    """
    text = text_of(file, COMPUTED)
    form = "JSON" if text.startswith("{") else "YAML"
    try:
        value = json.loads(text) if form == "JSON" else parse_yaml(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError([problem(file, NOWHERE, f"not valid {form}: {error}")]) from error
    if not isinstance(value, dict):
        raise ConfigError([problem(file, NOWHERE, f"expected settings (key: value) starting with {expected}")])
    return Document(file, text, value, {(): Location(NOWHERE, NOWHERE, "")})


def without_positions(value: Any) -> Iterator[tuple[KeyPath, Location]]:
    """Each key path in a value, with the text of its scalar and no position."""
    waiting: list[tuple[KeyPath, Any]] = [((), value)]
    while waiting:
        path, each = waiting.pop()
        inside: Iterable[tuple[str | int, Any]] = ()
        if isinstance(each, dict | list):
            inside = each.items() if isinstance(each, dict) else enumerate(each)
        waiting += [((*path, key), below) for key, below in inside]
        yield path, Location(NOWHERE, NOWHERE, "" if isinstance(each, dict | list) else str(each))


@dataclass(frozen=True, slots=True)
class _Builder:
    """Converts nodes to values; fills the other fields of a document."""

    document: Document
    environ: Mapping[str, str]

    def build(self, node: yaml.Node, path: KeyPath, key: Mark) -> Any:
        written = str(node.value) if isinstance(node, yaml.ScalarNode) else ""
        span = node.start_mark.index, node.end_mark.index
        self.document.places[path] = Location(key, mark_of(node), written, span)
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, path)
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path)
        return [self.build(child, (*path, i), mark_of(child)) for i, child in enumerate(node.value)]

    def _mapping(self, node: yaml.MappingNode, path: KeyPath) -> dict[Any, Any]:
        entries: dict[Any, tuple[yaml.Node, yaml.Node]] = {}
        for key_node, value_node in self._pairs(node, path):
            key = self._key(key_node, path)
            if key is None:
                continue
            if key in entries:
                first = mark_of(entries[key][0])
                message = f"the key {quoted(key)} is given twice, first at line {first.line} column {first.column}"
                self._mistake((*path, key), mark_of(key_node), message)
            else:
                entries[key] = key_node, value_node
        for key_node, value_node in self._merged(node, path):
            key = self._key(key_node, path)
            if key is not None:
                entries.setdefault(key, (key_node, value_node))
        return {key: self.build(value, (*path, key), mark_of(name)) for key, (name, value) in entries.items()}

    def _pairs(self, node: yaml.MappingNode, path: KeyPath) -> list[tuple[yaml.Node, yaml.Node]]:
        if node.tag != f"{TAG}map":
            self._mistake(path, mark_of(node), f"the tag {_short(node.tag)} means nothing here")
        return [(k, v) for k, v in node.value if k.tag != f"{TAG}merge"]

    def _merged(self, node: yaml.MappingNode, path: KeyPath) -> list[tuple[yaml.Node, yaml.Node]]:
        """Pairs merged by ``<<``, nearest first."""
        found: list[tuple[yaml.Node, yaml.Node]] = []
        for key, value in node.value:
            if key.tag != f"{TAG}merge":
                continue
            for origin in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                if isinstance(origin, yaml.MappingNode):
                    found += self._pairs(origin, path) + self._merged(origin, path)
                else:
                    self._mistake(path, mark_of(key), "'<<' expects *name of settings (key: value) further up")
        return found

    def _key(self, node: yaml.Node, path: KeyPath) -> str | int | None:
        key = self._plain(node, path) if isinstance(node, yaml.ScalarNode) else None
        if isinstance(key, str) or type(key) is int:
            return key
        what = quoted(node.value) if isinstance(node, yaml.ScalarNode) else "a list or mapping"
        advice = f'; write it in quotes: "{shortened(node.value)}"' if isinstance(node, yaml.ScalarNode) else ""
        self._mistake(path, mark_of(node), f"found {what} as a key, expected a name{advice}")
        return None

    def _scalar(self, node: yaml.ScalarNode, path: KeyPath) -> Any:
        value = self._plain(node, path)
        if not isinstance(value, str):
            return value
        if "\0" in value:
            return self._mistake(path, mark_of(node), "the character U+0000 cannot be part of a name or path")
        self.document.secrets.update(dict.fromkeys(secrets_of(value), HIDDEN))
        if value[:1] == "$" and value[1:] in self.environ:
            return self._mistake(path, mark_of(node), f"'{value}' is not replaced; write '${{{value[1:]}}}'")
        if "${" not in value:
            return value
        expansion = expand(value, self.environ)
        for mistake in expansion.mistakes:
            self._mistake(path, mark_of(node), mistake)
        if expansion.filled:
            self.document.environment[path] = expansion.shown
            self.document.secrets.update(expansion.filled)
        return None if expansion.mistakes else expansion.value

    def _plain(self, node: yaml.ScalarNode, path: KeyPath) -> str | int | float | bool | None:
        text: str = node.value
        try:
            match node.tag.removeprefix(TAG):
                case "str" | "merge":
                    return text
                case "null":
                    return None
                case "bool":
                    return {"true": True, "false": False}[text.lower()]
                case "int":
                    return int(text, 0)
                case "float":
                    number = WrittenFloat(re.sub(r"\.(?=inf|nan)", "", text, flags=re.IGNORECASE))
                    if math.isfinite(number):
                        return number
                    self._mistake(path, mark_of(node), f"found {text[:40]}, expected a finite number")
                    return None
        except (ValueError, KeyError):
            self._mistake(path, mark_of(node), f"{text[:40]!r} cannot be read as {_short(node.tag)}")
            return None
        self._mistake(path, mark_of(node), f"the tag {_short(node.tag)} means nothing here")
        return None

    def _mistake(self, path: KeyPath, mark: Mark, message: str) -> None:
        self.document.mistakes.setdefault(path, []).append(problem(self.document.file, mark, message, path))


def _with_value(written: str, value: str) -> str:
    """The text of a scalar, with its anchor and tag, and with another value."""
    before = _PROPERTIES.sub("", written, count=1).rstrip()
    after = written[len(written.rstrip()) :]
    return f"{written[: written.index(before)]}{json.dumps(value, ensure_ascii=False)}{after}"


def _short(tag: str) -> str:
    return tag.replace(TAG, "!!")
