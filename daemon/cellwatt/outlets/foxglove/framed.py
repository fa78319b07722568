"""Frames as messages of the topic ``/frame``, byte for byte as in recordings."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Final

import numpy as np

from cellwatt.frames import Frames, Layout
from cellwatt.outlets.foxglove.topics import Topic, channels_topic
from cellwatt.record.encoder import FRAME_TOPIC, PACKAGE, described
from cellwatt.record.protobuf import file_descriptor_set
from cellwatt.record.rows import FRAME_FIELDS, FRAMING, FrameRows, value_fields

_BODY: Final = np.dtype(FRAMING).itemsize
"""Bytes of a row before the message itself."""


class FrameMessages:
    """The topic of the frames of one layout, and its messages."""

    def __init__(self, layout: Layout) -> None:
        fields = value_fields(layout.names, FRAME_FIELDS)
        self.layout = layout
        self.fields = described(layout.channels, fields)
        self.topic = Topic(
            FRAME_TOPIC,
            "protobuf",
            f"{PACKAGE}.frame",
            file_descriptor_set(PACKAGE, "frame", (*FRAME_FIELDS, *fields)),
            {"declaration": json.dumps(asdict(layout)), "fields": json.dumps(self.fields)},
        )
        self._rows = FrameRows(layout)

    def of(self, frames: Frames) -> Iterator[bytes]:
        """One message for each frame of a block."""
        rows = self._rows.encode(frames, 0)
        data, size = rows.tobytes(), rows.dtype.itemsize
        for start in range(0, len(data), size):
            yield data[start + _BODY : start + size]

    def channels(self) -> tuple[Topic, bytes]:
        """The topic and message that name channel and unit of each field."""
        told = [{"field": name, **about} for name, about in self.fields.items()]
        return channels_topic(), json.dumps({"channels": told}).encode()
