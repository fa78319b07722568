"""What a consumer reads from Zenoh's samples and replies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cellwatt.batch import Batch
from cellwatt.errors import ProtocolError
from cellwatt.frames import Frames
from cellwatt.publish.encode import decode
from cellwatt.publish.follow import Positions
from cellwatt.publish.keys import FRAME
from cellwatt.publish.mark import Mark
from cellwatt.publish.messages import decode_item, from_json, parse_json
from cellwatt.results import Event, Result

if TYPE_CHECKING:
    import zenoh


@dataclass(frozen=True, slots=True)
class Health:
    """The cell's health message, about once a second; ``positions``: by topic, session and next number."""

    session: int
    time: int
    positions: Positions
    status: Mapping[str, Any]


def read_message(sample: zenoh.Sample, kind: str) -> tuple[Mark, Batch | Frames | Result | Event]:
    """Mark and content of a message of a kind of topic. Raises ``ProtocolError`` where it is none."""
    payload = sample.payload.to_bytes()
    mark = _mark(sample, payload)
    return mark, decode(payload, mark) if kind in ("raw", FRAME) else decode_item(kind, payload)


def _mark(sample: zenoh.Sample, payload: bytes) -> Mark:
    return Mark.decode(sample.attachment.to_bytes() if sample.attachment is not None else b"", payload)


def read_answer(sample: zenoh.Sample, topic: str) -> list[tuple[Mark, Batch | Frames | Result | Event]]:
    """What an answer about the past holds, in order. Raises ``ProtocolError``."""
    kind = topic.split("/", 1)[0]
    if kind in ("raw", FRAME):
        return [read_message(sample, kind)]
    payload = sample.payload.to_bytes()
    mark = _mark(sample, payload)
    try:
        marks = [
            (Mark(mark.session, _whole(b["mark"]["sequence"]), 1, mark.arrival, True), b) for b in parse_json(payload)
        ]
    except (ValueError, KeyError, TypeError) as error:
        raise ProtocolError(f"an answer about {topic} is not a list of results: {error}") from error
    return [(mark, from_json(kind, body)) for mark, body in marks]


def read_health(payload: bytes) -> Health:
    """Raises ``ProtocolError`` where it is no health message."""
    try:
        body = parse_json(payload)
        positions = {topic: (_whole(session), _whole(end)) for topic, (session, end) in body["positions"].items()}
        return Health(_whole(body["session"]), _whole(body["time"]), positions, body["status"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ProtocolError(f"a health message is not what its schema says: {error}") from error


def _whole(number: object) -> int:
    """A number as a mark holds it. Raises ``ValueError`` for any other."""
    if type(number) is not int or not -(1 << 63) <= number < 1 << 63:
        raise ValueError(f"{str(number)[:40]!r} is not a whole number of 64 bits")
    return number


def read_sessions(payload: bytes) -> list[int]:
    """The sessions of the recordings that a cell lists, oldest first."""
    try:
        return list(dict.fromkeys(_whole(recording["session"]) for recording in parse_json(payload)))
    except (ValueError, KeyError, TypeError):
        return []  # a cell that does not say of which sessions its recordings are


def read_refusal(error: zenoh.ReplyError) -> str | None:
    """What the cell says against a question; ``None`` where Zenoh itself gave up."""
    try:
        return str(parse_json(error.payload.to_bytes())["error"])
    except (ValueError, KeyError, TypeError):
        return None
