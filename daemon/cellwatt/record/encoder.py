"""Encoding of items for a file: topic, schema, bytes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray

from cellwatt.batch import Batch
from cellwatt.channel import Channel
from cellwatt.frames import FrameChannel, Frames
from cellwatt.record import messages, protobuf
from cellwatt.record.header import stream_to_dict
from cellwatt.record.openfile import OpenFile
from cellwatt.record.rows import FRAME_FIELDS, SAMPLE_FIELDS, FrameRows, SampleRows, value_fields
from cellwatt.results import Event, Result, series_of

Item = Batch | Frames | messages.Message

FRAME_TOPIC = "/frame"
PACKAGE = "cellwatt"


class Redeclared(Exception):  # noqa: N818
    """A topic now carries another stream or layout: it needs a new file."""


def topic_of(source: str, stream: str) -> str:
    """Topic under which samples of a stream are filed."""
    return f"/raw/{source}/{stream}"


class Encoder:
    """Puts items into one open file, declaring each topic when it is first used."""

    def __init__(self, file: OpenFile) -> None:
        self._file = file
        self._rows: dict[str, tuple[int, SampleRows | FrameRows]] = {}
        self._messages: dict[str, tuple[int, int]] = {}
        self._names: list[str] = []

    def add(self, item: Item, number: int | None = None) -> None:
        """Take one item into the file's chunk, wholly or not at all; ``number`` is that of a result or event.

        Raises ``Redeclared``, or ``ValueError`` where its contents cannot be written.
        """
        match item:
            case Batch():
                self._add_batch(item)
            case Frames():
                self._add_frames(item)
            case _:
                self._add_message(item, number)

    def _add_batch(self, batch: Batch) -> None:
        topic = topic_of(batch.source, batch.stream.name)
        number, rows = self._rows.get(topic, (0, None))
        if isinstance(rows, SampleRows):
            # Most often it is the same object, which spares comparing every channel.
            if rows.stream is not batch.stream and rows.stream != batch.stream:
                raise Redeclared
            self._file.add_rows(number, rows.encode(batch, number))
            return
        rows = SampleRows(batch.source, batch.stream)
        block = rows.encode(batch, self._file.next_channel)
        fields = value_fields(batch.stream.names, SAMPLE_FIELDS)
        metadata = {
            "source": batch.source,
            "stream": batch.stream.name,
            "declaration": json.dumps(stream_to_dict(batch.stream)),
            "fields": json.dumps(described(batch.stream.channels, fields)),
            "first": str(batch.sequence),
        }
        self._define_rows(
            topic, f"raw_{batch.source}_{batch.stream.name}", (*SAMPLE_FIELDS, *fields), metadata, rows, block
        )

    def _add_frames(self, frames: Frames) -> None:
        number, rows = self._rows.get(FRAME_TOPIC, (0, None))
        if isinstance(rows, FrameRows):
            if rows.layout is not frames.layout and rows.layout != frames.layout:
                raise Redeclared
            self._file.add_rows(number, rows.encode(frames, number))
            return
        rows = FrameRows(frames.layout)
        block = rows.encode(frames, self._file.next_channel)
        fields = value_fields(frames.layout.names, FRAME_FIELDS)
        metadata = {
            "declaration": json.dumps(asdict(frames.layout)),
            "fields": json.dumps(described(frames.layout.channels, fields)),
            "first": str(frames.sequence),
        }
        self._define_rows(FRAME_TOPIC, "frame", (*FRAME_FIELDS, *fields), metadata, rows, block)

    def _define_rows(
        self,
        topic: str,
        message: str,
        fields: tuple[protobuf.Field, ...],
        metadata: dict[str, str],
        rows: SampleRows | FrameRows,
        block: NDArray[np.void],
    ) -> None:
        (name,) = protobuf.identifiers([message], self._names)
        self._names.append(name)
        data = protobuf.file_descriptor_set(PACKAGE, name, fields)
        number = self._file.define(topic, "protobuf", Schema(0, data, "protobuf", f"{PACKAGE}.{name}"), metadata)
        self._rows[topic] = (number, rows)
        self._file.add_rows(number, block)

    def _add_message(self, message: messages.Message, given: int | None) -> None:
        """Under its number; where it was given none, in a channel of its own, as the next of it."""
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
    """Field name → the channel's true name and unit, for people and other tools."""
    return {
        field.name: {"channel": channel.name, "unit": channel.unit}
        for field, channel in zip(fields, channels, strict=True)
    }
