"""The questions of a consumer about missing messages. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import quote

from cellwatt.batch import Batch
from cellwatt.errors import ProtocolError
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.keys import FRAME, CellKeys, parse
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.order import Hole
from cellwatt.results import Event, Result


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
        """Raise ``ProtocolError`` if an answer is about other messages."""
        hole = self.hole
        end = math.inf if hole.count is None else hole.first + hole.count
        for mark, _ in parts:
            if mark.session != hole.session or mark.end <= hole.first or mark.sequence >= end:
                raise ProtocolError(
                    f"asked for {self.topic} from {hole.first} in session {hole.session}, the answer has"
                    f" {mark.sequence} to {mark.end} in session {mark.session}"
                )
