"""A cell's message as a consumer reads it: mark and Arrow stream."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from cellwatt.errors import ProtocolError
from cellwatt.outlets.zenoh import encode, received
from cellwatt.outlets.zenoh.mark import Mark
from fuzz.items import SESSION, batch, frames, same
from fuzz.message import MARK, sample
from fuzz.target import Target

BLOCKS = batch(5, 3), batch(5, 2, device=False), frames(7, 2)
SCHEMAS = {check: schema for check, schema, _ in map(encode.encode_apart, BLOCKS)}


def run(data: bytes) -> None:
    """A mark, then a payload; what was read and is sent on reads as the same."""
    size = MARK + 4 * (data[:1] == b"\2")
    try:
        mark, content = received.read_message(sample(data[:size], data[size:]), "raw", SCHEMAS)
    except ProtocolError:
        return
    assert not isinstance(content, str)
    assert mark.count == len(content)  # type: ignore[arg-type]
    again = encode.decode(encode.encode(content), mark)  # type: ignore[arg-type]
    assert same(content, again)


def seeds() -> Iterable[bytes]:
    """A batch with and without a device's clock, and frames; each with and without its schema."""
    for content in BLOCKS:
        mark = Mark(SESSION, content.sequence, len(content), SESSION)
        payload = encode.encode(content)
        yield mark.encode(payload)[:MARK] + payload
        check, _, rows = encode.encode_apart(content)
        yield replace(mark, schema=check).encode(rows)[: MARK + 4] + rows


TARGET = Target(run, seeds, 3000)
