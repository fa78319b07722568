"""Line protocol read back by its grammar: the other side of what is tested."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

_NAME = r"(?:[^\\,= ]|\\.)+"
_TAG = rf"({_NAME})=({_NAME})"
_FIELD = rf"""({_NAME})=("(?:[^"\\]|\\.)*"|[^", ]+)"""
_LINE = re.compile(
    rf"(?P<measurement>(?:[^\\, ]|\\.)+)(?P<tags>(?:,{_TAG})*) (?P<fields>{_FIELD}(?:,{_FIELD})*) (?P<time>-?\d+)",
    re.DOTALL,
)


@dataclass(frozen=True)
class Point:
    measurement: str
    tags: dict[str, str]
    fields: dict[str, Any]
    time: int


def parse(text: str) -> Point:
    """One line; AssertionError where it is none."""
    found = _LINE.fullmatch(text)
    assert found, text
    tags = {_plain(key): _plain(value) for key, value in re.findall(_TAG, found["tags"], re.DOTALL)}
    fields = {_plain(key): _value(value) for key, value in re.findall(_FIELD, found["fields"], re.DOTALL)}
    return Point(_plain(found["measurement"]), tags, fields, int(found["time"]))


def _plain(text: str) -> str:
    return re.sub(r"\\([,= ])", r"\1", text)


def _value(text: str) -> Any:
    if text.startswith('"'):
        return re.sub(r"\\(.)", r"\1", text[1:-1], flags=re.DOTALL)
    if text in ("true", "false"):
        return text == "true"
    return int(text[:-1]) if text.endswith("i") else float(text)
