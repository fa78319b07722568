"""Decodes items from the chunks of a file."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass

from mcap.opcode import Opcode
from mcap.records import Channel

from cellwatt.channel import Stream
from cellwatt.record import messages
from cellwatt.record.container import FRAMED_MESSAGE
from cellwatt.record.encoder import FRAME_TOPIC, Item
from cellwatt.record.rows import FrameRows, SampleRows, declared_rows

_KINDS = {topic: kind for kind, topic in messages.TOPICS.items()}
_LATEST_FIRST = 1 << 62
"""Upper limit of first numbers, so that later ones fit 64 bits."""
_LONGEST = 200  # characters of the fault of a declaration


@dataclass(frozen=True, slots=True)
class Track:
    """Reader of one channel: ``rows`` of blocks that begin at sequence number ``first``, or JSON of a ``kind``.

    ``series`` is what the numbers count within: the topic, or the series of results and events; None: no numbers.
    """

    topic: str
    rows: SampleRows | FrameRows | None = None
    kind: type[messages.Message] | None = None
    first: int = 0
    series: str | None = None


def track_of(channel: Channel) -> Track | None:
    """Return the reader of a channel; ``None`` if it is not cellwatt's. Raises ``ValueError`` if it is damaged."""
    topic, metadata = channel.topic, channel.metadata
    kind = _KINDS.get(topic)
    if kind is None and "declaration" not in metadata:
        return None
    try:
        if kind is not None and "series" not in metadata:
            return Track(topic, kind=kind)
        first = int(metadata["first"])
        if not 0 <= first < _LATEST_FIRST:
            raise ValueError(f"begins at number {first}")
        if kind is not None:
            return Track(topic, kind=kind, first=first, series=metadata["series"])
        rows = declared_rows(metadata)
        if isinstance(rows, FrameRows) != (topic == FRAME_TOPIC):
            raise ValueError("its kind does not fit its topic")
        return Track(topic, rows, first=first, series=topic)
    except (KeyError, ValueError) as error:
        why = " ".join(str(error).split())[:_LONGEST]
        raise ValueError(f"{channel.topic} has a declaration that this version does not know: {why}") from error


def tracks_of(channels: Mapping[int, Channel]) -> tuple[dict[int, Track], list[str]]:
    """Return readers of all channels of cellwatt, by number, and the faults of damaged channels."""
    found: dict[int, Track] = {}
    wrong: list[str] = []
    for number, channel in channels.items():
        try:
            track = track_of(channel)
        except ValueError as error:
            wrong.append(str(error))
            continue
        if track is not None:
            found[number] = track
    return found, wrong


def streams_of(tracks: Iterable[Track]) -> dict[str, tuple[Stream, ...]]:
    """The streams of samples by source, in the order of the sources' names."""
    found: dict[str, dict[str, Stream]] = {}
    for track in tracks:
        if isinstance(track.rows, SampleRows):
            found.setdefault(track.rows.source, {}).setdefault(track.rows.stream.name, track.rows.stream)
    return {source: tuple(streams.values()) for source, streams in sorted(found.items())}


def numbered(data: bytes, tracks: Mapping[int, Track], wanted: Container[int]) -> Iterator[tuple[int, Item]]:
    """Items of a chunk in order with their numbers, for the channels in ``wanted`` that ``tracks`` knows.

    The number of a block is that of its first row. Raises ``ValueError`` if a record does not fit its channel.
    """
    at, end = 0, len(data)
    while at + FRAMED_MESSAGE.size <= end:
        opcode, length, channel, sequence, _, _ = FRAMED_MESSAGE.unpack_from(data, at)
        if at + 9 + length > end:
            raise ValueError("a record in a chunk is cut")
        track = tracks.get(channel) if opcode == Opcode.MESSAGE and channel in wanted else None
        if track is None:
            at += 9 + length
        elif track.rows is not None:
            item, at = track.rows.decode(data, at, length, track.first)
            yield item.sequence, item
        else:
            assert track.kind is not None
            body = data[at + FRAMED_MESSAGE.size : at + 9 + length]
            at += 9 + length
            # The file stores the lowest 32 bits of a number.
            yield track.first + (sequence - track.first & 0xFFFFFFFF), messages.decode(track.kind, body)
