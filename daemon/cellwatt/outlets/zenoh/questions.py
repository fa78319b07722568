"""Questions to a cell, as consumers send them and as the cell parses them. Pure.

Anyone who reaches the cell's port may send any content.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote, unquote

from cellwatt.batch import Batch
from cellwatt.errors import CellwattError, ProtocolError
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.keys import FRAME, CellKeys, parse
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.order import Hole
from cellwatt.results import Event, Result

LARGEST: Final = 64 * 1024
"""Most bytes of a question including payload and attachment; valid questions need a few hundred."""
_LONGEST: Final = 4096
"""Most characters of the parameters."""
_HIGHEST: Final = 2**62
"""Limit of sessions, numbers and counts; sums of two still fit 64 bits."""
_DIGITS: Final = 19


class QuestionError(CellwattError):
    """A question is invalid."""


class NothingKeptError(QuestionError):
    """A question is valid, but the cell has none of the requested data."""


def parameters(text: str) -> dict[str, str]:
    """Parse ``name=value;…`` of a selector; of equal names the last counts. Raises ``QuestionError`` if too long."""
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
    """A whole number from 0 to 2⁶² − 1, or ``default`` if it is absent. Raises ``QuestionError``."""
    text = asked.get(name)
    if text is None:
        return default
    if not text.isascii() or not text.isdecimal():
        raise QuestionError(f"{name}={short(text)} is not a whole number")
    if len(text) > _DIGITS or int(text) >= _HIGHEST:
        raise QuestionError(f"{name}={short(text)} is too large")
    return int(text)


def short(text: str, most: int = 60) -> str:
    """Received text made safe to show: on one line, truncated to ``most`` characters."""
    return repr(text) if len(text) <= most else f"{text[:most]!r}…"


@dataclass(frozen=True, slots=True)
class Question:
    """A request for the missing messages of a topic."""

    topic: str
    hole: Hole

    def selector(self, keys: CellKeys) -> str:
        """The question as a Zenoh selector."""
        address = parse(keys.live(self.topic))
        asked: dict[str, object] = {"session": self.hole.session, "first": self.hole.first}
        if self.hole.count is not None:
            asked["count"] = self.hole.count
        if address.kind == "raw":
            asked |= {"source": address.names[0], "stream": address.names[1]}
        else:
            asked |= {"stream": FRAME} if self.topic == FRAME else {"kind": self.topic}
        name = "history" if address.kind in ("raw", FRAME) else "results"
        parameters = ";".join(f"{k}={quote(str(v), safe='')}" for k, v in asked.items())
        return f"{keys.question(name)}?{parameters}"

    def check(self, parts: Sequence[tuple[Mark, Batch | Frames | Result | Event]]) -> None:
        """Raise ``ProtocolError`` if an answer contains other messages than requested."""
        hole = self.hole
        end = math.inf if hole.count is None else hole.first + hole.count
        for mark, _ in parts:
            if mark.session != hole.session or mark.end <= hole.first or mark.sequence >= end:
                raise ProtocolError(
                    f"asked for {self.topic} from {hole.first} in session {hole.session}, the answer has"
                    f" {mark.sequence} to {mark.end} in session {mark.session}"
                )
