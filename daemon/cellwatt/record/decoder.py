"""Items back from the chunks of a file."""

from __future__ import annotations

import json
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass

from mcap.opcode import Opcode
from mcap.records import Channel

from cellwatt.frames import FrameChannel, Layout
from cellwatt.record import messages
from cellwatt.record.container import FRAMED_MESSAGE
from cellwatt.record.encoder import FRAME_TOPIC, Item
from cellwatt.record.header import stream_from_dict
from cellwatt.record.rows import FrameRows, SampleRows

_KINDS = {topic: kind for kind, topic in messages.TOPICS.items()}


@dataclass(frozen=True, slots=True)
class Track:
    """How to read one channel: ``rows`` of blocks that begin at sequence number ``first``, or JSON of a ``kind``."""

    topic: str
    rows: SampleRows | FrameRows | None = None
    kind: type[messages.Message] | None = None
    first: int = 0


def track_of(channel: Channel) -> Track | None:
    """How to read a channel; ``None`` where it is not one of ours. Raises ``ValueError`` where it is damaged."""
    kind = _KINDS.get(channel.topic)
    if kind is not None:
        return Track(channel.topic, kind=kind)
    if "declaration" not in channel.metadata:
        return None
    try:
        declared, first = json.loads(channel.metadata["declaration"]), int(channel.metadata["first"])
        if channel.topic == FRAME_TOPIC:
            columns = tuple(FrameChannel(**column) for column in declared["channels"])
            return Track(channel.topic, FrameRows(Layout(columns, declared["rate"])), first=first)
        return Track(channel.topic, SampleRows(channel.metadata["source"], stream_from_dict(declared)), first=first)
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{channel.topic} is declared in a way this version does not know: {error}") from error


def items(data: bytes, tracks: Mapping[int, Track], wanted: Container[int]) -> Iterator[Item]:
    """The items of a chunk's records in order, of the channels in ``wanted`` that ``tracks`` knows.

    Raises ``ValueError`` where a record does not fit its channel.
    """
    at, end = 0, len(data)
    while at + FRAMED_MESSAGE.size <= end:
        opcode, length, channel, _, _, _ = FRAMED_MESSAGE.unpack_from(data, at)
        track = tracks.get(channel) if opcode == Opcode.MESSAGE and channel in wanted else None
        if track is None:
            at += 9 + length
        elif track.rows is not None:
            item, at = track.rows.decode(data, at, length, track.first)
            yield item
        else:
            assert track.kind is not None
            body = data[at + FRAMED_MESSAGE.size : at + 9 + length]
            at += 9 + length
            yield messages.decode(track.kind, body)
