"""YAML by any author: one schema for all files, and limits of size and depth."""

from __future__ import annotations

import re
from typing import Any, ClassVar, Final

import yaml

DEEPEST: Final = 50
"""Largest nesting depth of lists and mappings."""
MOST_VALUES: Final = 5_000_000
"""Largest number of values after aliases are expanded; a few nested aliases can expand to billions."""
MOST_MERGES: Final = 1_000
"""Largest number of merge keys (``<<``); each costs time proportional to the number of all others."""

_LONGEST: Final = 200  # characters of a reason

TAG: Final = "tag:yaml.org,2002:"


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """YAML 1.2 core schema instead of PyYAML's 1.1: ``on``, ``no``, ``12:30``, ``0123`` and dates are text."""

    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}


for _kind, _pattern, _first in (
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
    Loader.add_implicit_resolver(f"{TAG}{_kind}", re.compile(rf"(?:{_pattern})\Z"), list(_first))


class NotYamlError(yaml.YAMLError, ValueError):
    """A text is not YAML, or exceeds the limits; the message gives position and reason in one line."""


def parse_yaml(text: str) -> Any:
    """Content of a YAML text. Raises ``NotYamlError``."""
    try:
        check_bounds(text, MOST_VALUES, Loader)
        return yaml.load(text, Loader=Loader)
    except yaml.YAMLError as error:
        raise NotYamlError(" ".join(str(error).split())[:_LONGEST]) from error
    except (ValueError, KeyError, IndexError, AttributeError, TypeError, OverflowError) as error:
        # Raised by the constructors of numbers, booleans and dates: !!bool 5, !!timestamp x …
        raise NotYamlError(f"a value cannot be read: {' '.join(str(error).split())[:_LONGEST]}") from error


class TooMuchError(yaml.MarkedYAMLError):
    """A text is nested too deeply or has too many values; the message gives position and reason."""

    def __init__(self, event: yaml.Event, problem: str) -> None:
        mark: Any = event.start_mark
        super().__init__(problem=problem, problem_mark=mark)
        self.args = (f"line {mark.line + 1} column {mark.column + 1}: {problem}",)

    def __str__(self) -> str:
        return str(self.args[0])


def check_bounds(text: str, values: int, loader: Any) -> None:
    """Raise ``TooMuchError`` for text nested too deep or with more than ``values``, ``YAMLError`` for other faults."""
    sizes: list[int] = [0]
    depths: list[int] = [0]
    names: list[str | None] = []
    anchors: dict[str, tuple[int, int]] = {}
    merges = 0
    for event in yaml.parse(text, Loader=loader):
        size, depth = 1, 0
        match event:
            case yaml.AliasEvent():
                if event.anchor in names:
                    raise TooMuchError(event, "an anchor that contains itself")
                size, depth = anchors.get(str(event.anchor), (1, 0))
            case yaml.CollectionStartEvent():
                names.append(event.anchor)
                sizes.append(1)
                depths.append(0)
                depth = -1
            case yaml.CollectionEndEvent():
                size, depth = sizes.pop(), depths.pop() + 1
                _name(anchors, names.pop(), size, depth)
            case yaml.ScalarEvent():
                _name(anchors, event.anchor, 1, 0)
                merges += event.value == "<<"
            case _:
                continue
        if depth >= 0:
            sizes[-1] += size
            depths[-1] = max(depths[-1], depth)
        if len(sizes) - 1 + depths[-1] > DEEPEST:
            raise TooMuchError(event, f"nested more than {DEEPEST} deep")
        if merges > MOST_MERGES:
            raise TooMuchError(event, f"more than {MOST_MERGES:,} merge keys (<<)")
        if sizes[-1] > values:
            raise TooMuchError(event, f"stands for more than {values:,} values")


def _name(anchors: dict[str, tuple[int, int]], name: str | None, size: int, depth: int) -> None:
    if name is not None:
        anchors[name] = size, depth
