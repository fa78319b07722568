"""The ring's items: what is put in comes out, in order and whole, or is told as skipped."""

from __future__ import annotations

from collections.abc import Iterable

from cellwatt.record import decoder
from cellwatt.ring.items import Item, ItemReader, ItemWriter, Mark, Status
from cellwatt.ring.memory import Ring
from fuzz import rows
from fuzz.items import MESSAGES, batch, frames, same
from fuzz.target import Target

SIZE = 4096
"""Bytes of the ring: some records, and a few of the largest inputs only in parts."""


def run(data: bytes) -> None:
    """Items as the rows of a chunk; every byte of the first eight says how many are put before the reader looks."""
    how, data = data[:8], data[8:]
    items: list[Item] = [Status({"how": list(how)}), Mark(len(data))]
    try:
        items += [item for _, item in decoder.numbered(data, rows.TRACKS, set(rows.TRACKS))]
    except ValueError:
        return
    _through(Ring(SIZE, 1), items, how or b"\1")


def _through(ring: Ring, items: list[Item], how: bytes) -> None:
    writer, reader = ItemWriter(ring), ItemReader(ring, 0)
    found: list[Item] = []
    for i, item in enumerate(items):
        try:
            writer.put(item)
        except ValueError:  # larger than the ring takes
            return
        if i % (1 + how[i % len(how)] % 16) == 0:
            found += reader.items()
            reader.settle()
    writer.end()
    found += reader.items()
    assert reader.over
    if reader.skipped or any(map(_in_parts, items)):
        return
    assert len(found) == len(items)
    assert all(same(one, other) for one, other in zip(items, found, strict=True))


def _in_parts(item: Item) -> bool:
    return hasattr(item, "__len__") and len(item) > 1


def seeds() -> Iterable[bytes]:
    """Single samples and frames, messages of every kind, and a block that goes in parts."""
    singles = b"".join(rows.encoded(batch(i, 1, device=i % 2 == 0)) for i in range(3))
    yield bytes(range(8)) + singles + rows.encoded(frames(5_000_000_000, 1)) + rows.encoded(MESSAGES[0])
    yield bytes(8) + rows.encoded(batch(0, 12))
    yield b"\xff" * 8 + rows.encoded(MESSAGES[1]) * 3


TARGET = Target(run, seeds, 2048)
