"""Parses Zenoh's samples and replies for a consumer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from cellwatt.batch import Batch
from cellwatt.errors import ProtocolError
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.encode import decode
from cellwatt.outlets.zenoh.keys import FRAME, is_topic
from cellwatt.outlets.zenoh.mark import Mark, Positions
from cellwatt.outlets.zenoh.messages import LONGEST_REASON, decode_item, from_json, parse_json
from cellwatt.results import Event, Result

if TYPE_CHECKING:
    import zenoh


_LARGEST_JSON: Final = 4 * 1024 * 1024
"""Most bytes of one result, event or health message; the largest of a cell have some 100 kB."""
_MOST_TOPICS: Final = 1000
_END: Final = 2**63
"""Limit of numbers and times."""


@dataclass(frozen=True, slots=True)
class Health:
    """The cell's health message, about once per second; ``positions``: session and next number by topic."""

    session: int
    time: int
    positions: Positions
    status: Mapping[str, Any]


class UnknownSchemaError(ProtocolError):
    """A message of samples or frames lacks its schema, which has not been received yet."""


def read_message(
    sample: zenoh.Sample, kind: str, schemas: Mapping[int, bytes] = MappingProxyType({})
) -> tuple[Mark, Batch | Frames | Result | Event]:
    """Mark and content of a message of a kind of topic; ``schemas`` are Arrow schemas by their CRC-32.

    Raises ``UnknownSchemaError`` if the message's schema is not among them, another ``ProtocolError`` if it is invalid.
    """
    payload = sample.payload.to_bytes()
    mark = _mark(sample, payload)
    with _reading(f"a message of {kind}"):
        if kind in ("raw", FRAME):
            if mark.schema and mark.schema not in schemas:
                raise UnknownSchemaError(f"a message of {kind} needs the schema {mark.schema:08x}")
            return mark, decode(schemas[mark.schema] + payload if mark.schema else payload, mark)
        if mark.count != 1:
            raise ProtocolError(f"a message of {kind} is one, not {mark.count}")
        return mark, decode_item(kind, _small(payload))


def _mark(sample: zenoh.Sample, payload: bytes) -> Mark:
    mark = Mark.decode(sample.attachment.to_bytes() if sample.attachment is not None else b"", payload)
    if mark.session < 0 or mark.sequence < 0 or mark.end >= _END or mark.count < 1:
        raise ProtocolError(f"an invalid mark: {mark}")
    return mark


def _small(payload: bytes) -> bytes:
    if len(payload) > _LARGEST_JSON:
        raise ProtocolError(f"a JSON message of {len(payload)} bytes; {_LARGEST_JSON} are the most")
    return payload


@contextmanager
def _reading(what: str) -> Iterator[None]:
    """Convert every error in parsing received bytes into ``ProtocolError``."""
    try:
        yield
    except ProtocolError:
        raise
    except Exception as error:
        raise ProtocolError(f"{what} does not match its schema: {type(error).__name__}: {error}") from error


def read_answer(sample: zenoh.Sample, topic: str) -> list[tuple[Mark, Batch | Frames | Result | Event]]:
    """The messages in an answer about the past, in order. Raises ``ProtocolError``."""
    kind = topic.split("/", 1)[0]
    if kind in ("raw", FRAME):
        return [read_message(sample, kind)]
    payload = sample.payload.to_bytes()
    mark = _mark(sample, payload)
    with _reading(f"an answer about {topic}"):
        return [(_within(mark, body), from_json(kind, body)) for body in parse_json(payload)]


def _within(whole: Mark, body: Mapping[str, Any]) -> Mark:
    """The mark of one of the results in an answer."""
    sequence = body["mark"]["sequence"]
    if not isinstance(sequence, int) or not whole.sequence <= sequence < whole.end:
        raise ProtocolError(f"a result has number {sequence!r} in an answer of {whole.sequence} to {whole.end}")
    return Mark(whole.session, sequence, 1, whole.arrival, True)


def read_health(sample: zenoh.Sample) -> tuple[Mark, Health]:
    """Mark and content of a health message. Raises ``ProtocolError``."""
    payload = sample.payload.to_bytes()
    mark = _mark(sample, payload)
    with _reading("a health message"):
        body = parse_json(_small(payload))
        if len(body["positions"]) > _MOST_TOPICS:
            raise ProtocolError(f"a health message has {len(body['positions'])} topics")
        positions = {t: (_number(s), _number(end)) for t, (s, end) in body["positions"].items() if is_topic(t)}
        return mark, Health(_number(body["session"]), _number(body["time"]), positions, dict(body["status"]))


def _number(value: object) -> int:
    if type(value) is not int or not 0 <= value < _END:
        raise ProtocolError(f"a health message has {value!r:.60} where a number should be")
    return value


def read_sessions(payload: bytes) -> list[int]:
    """Sessions of the recordings that a cell lists, oldest first; none if the answer is invalid."""
    try:
        with _reading("the list of recordings"):
            return list(dict.fromkeys(_number(recording["session"]) for recording in parse_json(payload)))
    except ProtocolError:
        return []  # a cell whose list of recordings lacks the sessions


def read_refusal(error: zenoh.ReplyError) -> str | None:
    """The reason why the cell refused a question; ``None`` for an error of Zenoh itself."""
    try:
        with _reading("a refusal"):
            return str(parse_json(_small(error.payload.to_bytes()))["error"])[:LONGEST_REASON]
    except ProtocolError:
        return None
