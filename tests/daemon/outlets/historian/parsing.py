"""Line protocol read back by its rules, character by character: the other side of what is tested."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Point:
    measurement: str
    tags: dict[str, str]
    fields: dict[str, Any]
    time: int


def parse(text: str) -> Point:
    """One line; AssertionError where it is none."""
    head, rest = _until(text, " ")
    body, time = rest[: rest.rindex(" ")], rest[rest.rindex(" ") + 1 :]
    parts = _split(head, ",")
    tags = {}
    for part in parts[1:]:
        key, value = _split(part, "=")
        assert key, text
        assert value, text
        tags[_plain(key)] = _plain(value)
    fields = {}
    for part in _split(body, ",", quotes=True):
        key, value = _until(part, "=")
        fields[_plain(key)] = _value(value)
    assert fields
    return Point(_plain(parts[0]), tags, fields, int(time))


def _until(text: str, end: str) -> tuple[str, str]:
    at = 0
    while text[at] != end:
        at += 2 if text[at] == "\\" else 1
    return text[:at], text[at + 1 :]


def _split(text: str, at: str, quotes: bool = False) -> list[str]:
    found, word, quoted, i = [], "", False, 0
    while i < len(text):
        if text[i] == "\\":
            word, i = f"{word}{text[i : i + 2]}", i + 2
            continue
        if text[i] == '"' and quotes and (quoted or word.endswith("=")):  # in values alone
            quoted = not quoted
        if text[i] == at and not quoted:
            found, word = [*found, word], ""
        else:
            word += text[i]
        i += 1
    assert not quoted
    return [*found, word]


def _plain(text: str) -> str:
    for special in (",", "=", " "):
        text = text.replace(f"\\{special}", special)
    return text


def _value(text: str) -> Any:
    if text.startswith('"'):
        assert text.endswith('"')
        return text[1:-1].replace('\\"', '"').replace("\\\\", "\\")
    if text in ("true", "false"):
        return text == "true"
    return int(text[:-1]) if text.endswith("i") else float(text)
