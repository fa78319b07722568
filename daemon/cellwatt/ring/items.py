"""The daemon's items in a ring: samples and frames as rows of the record, others as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from cellwatt.batch import Batch
from cellwatt.frames import Frames, cut
from cellwatt.record import messages
from cellwatt.record.encoder import FRAME_TOPIC, topic_of_block
from cellwatt.record.rows import FrameRows, SampleRows, declared_rows, rows_of
from cellwatt.ring.memory import Record, Ring

_ROWS, STATUS, _MARK, _FIRST_MESSAGE = 1, 2, 3, 16
_KINDS = {kind: number for number, kind in enumerate(messages.TOPICS, _FIRST_MESSAGE)}
_TYPES = {number: kind for kind, number in _KINDS.items()}


@dataclass(frozen=True, slots=True)
class Status:
    """Figures of the writing process for health; they wake no reader."""

    figures: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Mark:
    """Marks the position from which the settings numbered ``generation`` apply."""

    generation: int


Item = Batch | Frames | messages.Message | Status | Mark


def kind_of(kind: type[messages.Message]) -> int:
    """The number of a kind of message, the same in every ring."""
    return _KINDS[kind]


class ItemWriter:
    """Puts items into a ring; a writer continues the numbering of its predecessor."""

    def __init__(self, ring: Ring) -> None:
        self._ring = ring
        self._rows: dict[str, tuple[int, SampleRows | FrameRows]] = {}
        """Number and rows of each channel, by topic."""
        self._count = _FIRST_MESSAGE + len(_KINDS)
        """Number of the next channel of rows; lower numbers belong to kinds without rows."""
        for line in ring.declared()[0]:
            plain = json.loads(line)
            self._know(plain["topic"], plain["number"], declared_rows(plain))

    def put(self, item: Item) -> None:
        """Add one item; a block that is too large for the ring is split."""
        match item:
            case Batch() | Frames():
                number, rows = self._rows_of(item)
                self._put_rows(item, number, rows.encode(item, number).tobytes())
            case Status():
                self._put_message(STATUS, json.dumps(item.figures, default=_plain).encode(), silent=True)
            case Mark():
                self._put_message(_MARK, str(item.generation).encode())
            case _:
                self._put_message(_KINDS[type(item)], messages.encode(item))

    def numbers(self) -> dict[str, dict[str, int]]:
        """Next sequence number of each stream, by source."""
        found: dict[str, dict[str, int]] = {}
        for number, rows in self._rows.values():
            if isinstance(rows, SampleRows):
                found.setdefault(rows.source, {})[rows.stream.name] = self._ring.following(number)
        return found

    def frames(self) -> tuple[int, int]:
        """Next sequence number of the frames, and time of the last one, ns; zeros before the first."""
        known = self._rows.get(FRAME_TOPIC)
        return (0, 0) if known is None else (self._ring.following(known[0]), self._ring.note)

    def end(self) -> None:
        """Declare that no more items will come."""
        self._ring.end()

    def _put_message(self, kind: int, body: bytes, silent: bool = False) -> None:
        self._ring.put(kind, kind, self._ring.following(kind), 1, body, silent=silent)

    def _put_rows(self, item: Batch | Frames, number: int, body: bytes) -> None:
        if len(body) <= self._ring.largest or len(item) == 1:
            note = int(item.time[-1]) if isinstance(item, Frames) else None
            self._ring.put(_ROWS, number, item.sequence, len(item), body, note)
            return
        middle = len(item) // 2
        self.put(cut(item, 0, middle))
        self.put(cut(item, middle, len(item)))

    def _rows_of(self, block: Batch | Frames) -> tuple[int, SampleRows | FrameRows]:
        topic = topic_of_block(block)
        known = self._rows.get(topic)
        if known is not None and known[1].fits(block):
            return known
        rows, number = rows_of(block), self._count
        self._ring.declare(json.dumps({**rows.declaration, "topic": topic, "number": number}).encode())
        return self._know(topic, number, rows)

    def _know(self, topic: str, number: int, rows: SampleRows | FrameRows) -> tuple[int, SampleRows | FrameRows]:
        self._count = number + 1
        self._rows[topic] = known = number, rows
        return known


class ItemReader:
    """Reads the items of a ring as reader number ``reader``, from the last settled position.

    ``position`` is the start of the next item; ``settle`` marks everything before it as done.
    """

    def __init__(self, ring: Ring, reader: int) -> None:
        self.ring = ring
        self.reader = reader
        self.position = ring.position(reader)
        self.count = 0
        """Items read, without ``Status``."""
        self.skipped = 0
        """Bytes that were overwritten before they were read."""
        self._rows: dict[int, SampleRows | FrameRows] = {}
        self._declared = 0
        self._channel = 0
        self.sequence = 0
        """Number, within its channel, of the item read last."""

    @property
    def bell(self) -> int:
        """A descriptor that becomes readable when there is a new item, if this reader listens."""
        return self.ring.bell(self.reader)

    def listen(self) -> bool:
        """Have ``bell`` rung at each new item; return True if an unread item is present."""
        self.ring.listen(self.reader)
        return self.ring.head > self.position

    def quiet(self) -> None:
        """Reset ``bell`` and stop listening."""
        self.ring.listen(self.reader, False)
        self.ring.quiet(self.reader)

    def items(self) -> Iterator[Item]:
        """Read all items present at the call, in order; later ones are left for the next call, so that it ends."""
        end = self.ring.head
        while self.position < end:
            record, following = self.ring.read(self.position)
            missed = following - self.position
            self.position = following
            if record is not None:
                self.count += record.kind != STATUS
                yield self._item(record)
            elif missed:
                self.skipped += missed
            else:
                return

    def settle(self) -> None:
        """Mark all items read as done."""
        self.ring.settle(self.reader, self.position)

    def newest(self) -> int:
        """Next sequence number of the channel read last."""
        return self.ring.following(self._channel)

    @property
    def over(self) -> bool:
        """True if the writer has ended and everything was read."""
        return self.ring.ended and self.position >= self.ring.head

    def _item(self, record: Record) -> Item:
        self.sequence = record.sequence
        if record.kind == _ROWS:
            self._channel = record.channel
            rows = self._rows.get(record.channel) or self._look_up(record.channel)
            size = int.from_bytes(record.body[1:9], "little")
            if isinstance(rows, SampleRows):
                return rows.decode(record.body, 0, size, record.sequence, keep=True)[0]
            return rows.decode(record.body, 0, size, record.sequence)[0]
        if record.kind == STATUS:
            return Status(json.loads(record.body))
        if record.kind == _MARK:
            return Mark(int(record.body))
        return messages.decode(_TYPES[record.kind], record.body)

    def _look_up(self, channel: int) -> SampleRows | FrameRows:
        lines, self._declared = self.ring.declared(self._declared)
        self._rows.update(map(_read_declaration, lines))
        return self._rows[channel]


def _plain(value: Any) -> Any:
    """Figures of a driver of any author: numpy's numbers as numbers, other objects as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _read_declaration(line: bytes) -> tuple[int, SampleRows | FrameRows]:
    plain = json.loads(line)
    return plain["number"], declared_rows(plain)
