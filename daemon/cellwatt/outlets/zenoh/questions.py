"""Parses the parameters of a question. Pure. Anyone who reaches the cell's port may put anything into one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final
from urllib.parse import unquote

from cellwatt.errors import CellwattError

LARGEST: Final = 64 * 1024
"""Bytes of a question with all that was sent along; nothing that is asked here needs more than a few hundred."""
_LONGEST: Final = 4096
"""Characters of the parameters."""
_HIGHEST: Final = 2**62
"""No session, number or count is above it, and sums of two still fit 64 bits."""
_DIGITS: Final = 19


class QuestionError(CellwattError):
    """A question is wrong."""


class NothingKeptError(QuestionError):
    """A question is valid, but there is nothing to answer it with."""


def parameters(text: str) -> dict[str, str]:
    """Parse ``name=value;…`` of a selector; the last of equal names counts. Raises ``QuestionError`` if too long."""
    if len(text) > _LONGEST:
        raise QuestionError(f"a question may have {_LONGEST} characters of parameters, this one has {len(text)}")
    pairs = (pair.partition("=") for pair in text.split(";"))
    return {name: unquote(value) for name, _, value in pairs if name}


def text_of(asked: Mapping[str, str], name: str) -> str:
    """A required parameter. Raises ``QuestionError`` if it is missing."""
    if not asked.get(name):
        raise QuestionError(f"the question needs {name}=…")
    return asked[name]


def number_of(asked: Mapping[str, str], name: str, default: int) -> int:
    """A required whole number from 0 to 2⁶² − 1. Raises ``QuestionError``."""
    text = asked.get(name)
    if text is None:
        return default
    if not text.isascii() or not text.isdecimal():
        raise QuestionError(f"{name}={short(text)} is not a whole number")
    if len(text) > _DIGITS or int(text) >= _HIGHEST:
        raise QuestionError(f"{name}={short(text)} is too large")
    return int(text)


def short(text: str, most: int = 60) -> str:
    """Received text made safe to show: on one line, and cut off after ``most`` characters."""
    return repr(text) if len(text) <= most else f"{text[:most]!r}…"
