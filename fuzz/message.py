"""A cell's message as a consumer reads it: key, mark and JSON."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

from cellwatt.errors import CellwattError, ProtocolError
from cellwatt.outlets.zenoh import messages, received
from cellwatt.outlets.zenoh.keys import CellKeys, alarm_path, parse, raw_topic, topic_of_series
from cellwatt.outlets.zenoh.mark import Mark
from fuzz.items import MESSAGES, SESSION
from fuzz.target import Target

MARK = 32


def sample(mark: bytes, payload: bytes) -> Any:
    """As Zenoh gives it; a mark of full length gets the sum that belongs to it."""
    attachment = mark + zlib.crc32(payload, zlib.crc32(mark)).to_bytes(4, "little") if len(mark) >= MARK else mark

    def holding(data: bytes) -> Any:
        return SimpleNamespace(to_bytes=lambda: data)

    return SimpleNamespace(payload=holding(payload), attachment=holding(attachment))


def run(data: bytes) -> None:
    """A key up to a line break, then a mark and a payload."""
    key, _, rest = data.partition(b"\n")
    mark, payload = rest[:MARK], rest[MARK:]
    kinds: list[str] = list(messages.TYPES)
    with suppress(ProtocolError):
        address = parse(key.decode("utf-8", "replace"))
        kinds.insert(0, address.kind)
        with suppress(CellwattError):
            again = parse(CellKeys(address.site, address.cell).live(address.topic))
            assert (again.site, again.cell, again.topic) == (address.site, address.cell, address.topic)
    found = sample(mark, payload)
    for kind in dict.fromkeys(kinds):
        if kind in messages.TYPES:
            with suppress(ProtocolError):
                _one(kind, *received.read_message(found, kind))
            with suppress(ProtocolError):
                for part, content in received.read_answer(found, kind):
                    _one(kind, part, content)
    with suppress(ProtocolError):
        _, health = received.read_health(found)
        assert all(type(number) is int for position in health.positions.values() for number in position)
    assert all(type(session) is int for session in received.read_sessions(payload))
    said: Any = SimpleNamespace(payload=found.payload)
    assert isinstance(received.read_refusal(said), str | None)


def _one(kind: str, mark: Mark, content: Any) -> None:
    """What was read and is sent on reads as the same."""
    assert all(type(number) is int for number in (mark.session, mark.sequence, mark.count, mark.arrival))
    again = messages.decode_item(kind, messages.encode_item(content, mark))
    assert messages.encode_item(again, mark) == messages.encode_item(content, mark)


def seeds() -> Iterable[bytes]:
    """A live message of each kind, an answer, health, recordings, a refusal."""
    keys = CellKeys("plant/1", "weld")
    mark = Mark(SESSION, 7, 1, SESSION + 5)
    for item in MESSAGES:
        with suppress(StopIteration):
            topic = messages.topic_of(item)  # type: ignore[arg-type]
            body = messages.encode_item(item, mark)  # type: ignore[arg-type]
            yield keys.live(topic).encode() + b"\n" + mark.encode(body)[:MARK] + body
    answer = b"[" + messages.encode_item(MESSAGES[1], mark) + b"]"  # type: ignore[arg-type]
    yield keys.question("results").encode() + b"\n" + mark.encode(answer)[:MARK] + answer
    health = messages.health(mark, SESSION, {raw_topic("arm", "rtde"): (SESSION, 90)}, {"state": "ok"})
    yield keys.live("health").encode() + b"\n" + mark.encode(health)[:MARK] + health
    yield keys.live(alarm_path("error", "joint fault", "a1")).encode() + b"\n" + bytes(MARK) + b'[{"session":5}]'
    yield keys.live(topic_of_series("prediction/p#1")).encode() + b"\n" + bytes(MARK) + b'{"error":"no"}'


TARGET = Target(run, seeds, 2048)
