"""A cell's message as a consumer reads it: mark and Arrow stream."""

from __future__ import annotations

from collections.abc import Iterable

from cellwatt.batch import Batch
from cellwatt.errors import ProtocolError
from cellwatt.outlets.zenoh import encode, received
from cellwatt.outlets.zenoh.mark import Mark
from fuzz.items import SESSION, batch, frames, same
from fuzz.message import MARK, sample
from fuzz.target import Target


def run(data: bytes) -> None:
    """A mark, then a payload; what was read and is sent on reads as the same."""
    try:
        mark, content = received.read_message(sample(data[:MARK], data[MARK:]), "raw")
    except ProtocolError:
        return
    assert not isinstance(content, str)
    assert mark.count == len(content)  # type: ignore[arg-type]
    if isinstance(content, Batch):
        again = encode.decode(encode.encode_batch(content), mark)
    else:
        again = encode.decode(encode.encode_frames(content), mark)  # type: ignore[arg-type]
    assert same(content, again)
    encode.named(again)


def seeds() -> Iterable[bytes]:
    """A batch with and without a device's clock, and frames."""
    for content in (batch(5, 3), batch(5, 2, device=False), frames(7, 2)):
        mark = Mark(SESSION, content.sequence, len(content), SESSION)
        payload = encode.encode_batch(content) if isinstance(content, Batch) else encode.encode_frames(content)
        yield mark.encode(payload)[:MARK] + payload


TARGET = Target(run, seeds, 3000)
