"""Encoding of items for a file: topic, schema, bytes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from mcap.records import Schema

from cellwatt import protobuf
from cellwatt.batch import Batch
from cellwatt.channel import Channel
from cellwatt.frames import FrameChannel, Frames
from cellwatt.record import messages
from cellwatt.record.openfile import OpenFile
from cellwatt.record.rows import BlockRows, rows_of, value_fields
from cellwatt.results import Event, Result, series_of

Item = Batch | Frames | messages.Message

FRAME_TOPIC = "/frame"
PACKAGE = "cellwatt"


class Redeclared(Exception):  # noqa: N818
    """The stream or layout of a topic has changed, which needs a new file."""


def topic_of(source: str, stream: str) -> str:
    """Topic of the samples of a stream."""
    return f"/raw/{source}/{stream}"


def topic_of_block(block: Batch | Frames) -> str:
    """Topic of a block."""
    return topic_of(block.source, block.stream.name) if isinstance(block, Batch) else FRAME_TOPIC


class Encoder:
    """Puts items into one open file, declaring each topic when it is first used."""

    def __init__(self, file: OpenFile) -> None:
        self._file = file
        self._rows: dict[str, tuple[int, BlockRows]] = {}
        self._messages: dict[str, tuple[int, int]] = {}
        self._names: list[str] = []

    def add(self, item: Item, number: int | None = None) -> None:
        """Add one item to the file's chunk, wholly or not at all; ``number`` is that of a result or event.

        Raises ``Redeclared``, or ``ValueError`` if its contents cannot be encoded.
        """
        if isinstance(item, Batch | Frames):
            self._add_block(item)
        else:
            self._add_message(item, number)

    def _add_block(self, block: Batch | Frames) -> None:
        topic = topic_of_block(block)
        known: tuple[int, BlockRows] = self._rows.get(topic) or (0, rows_of(block))
        number, rows = known
        if not rows.fits(block):
            raise Redeclared
        records = rows.encode(block, number or self._file.next_channel)
        if not number:
            number = self._define(topic, rows, block.sequence)
            self._rows[topic] = (number, rows)
        self._file.add_rows(number, records)

    def _define(self, topic: str, rows: BlockRows, first: int) -> int:
        (name,) = protobuf.identifiers([topic.removeprefix("/").replace("/", "_")], self._names)
        self._names.append(name)
        fields = value_fields([channel.name for channel in rows.channels], rows.fixed)
        data = protobuf.file_descriptor_set(PACKAGE, name, (*rows.fixed, *fields))
        about = {"fields": json.dumps(described(rows.channels, fields)), "first": str(first)}
        schema = Schema(0, data, "protobuf", f"{PACKAGE}.{name}")
        return self._file.define(topic, "protobuf", schema, {**rows.declaration, **about})

    def _add_message(self, message: messages.Message, given: int | None) -> None:
        """Add a message under its number; without one, under the next number of a separate channel."""
        kind = type(message)
        topic, data, time = messages.TOPICS[kind], messages.encode(message), messages.time_of(message)
        series = series_of(message) if given is not None and isinstance(message, Result | Event) else None
        number, following = self._messages.get(series or topic, (0, 0))
        sequence = following if given is None else given
        if not number:
            schema = Schema(0, messages.schema(kind), "jsonschema", f"{PACKAGE}.{kind.__name__}")
            metadata = {} if series is None else {"series": series, "first": str(sequence)}
            number = self._file.define(topic, "json", schema, metadata)
        self._messages[series or topic] = (number, sequence + 1)
        self._file.add_message(number, sequence, time, data)


def described(
    channels: Sequence[Channel | FrameChannel], fields: tuple[protobuf.Field, ...]
) -> dict[str, dict[str, Any]]:
    """The channel's full name and unit by field name, for people and other tools."""
    return {
        field.name: {"channel": channel.name, "unit": channel.unit}
        for field, channel in zip(fields, channels, strict=True)
    }
