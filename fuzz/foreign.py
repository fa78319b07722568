"""MCAP files of other writers, as logs of joints."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable

import numpy as np
from mcap.writer import CompressionType, Writer

from cellwatt.errors import CellwattError
from cellwatt.tables import read_table
from fuzz.target import Target, folder


def run(data: bytes) -> None:
    """A file is refused, or gives joints at times that rise."""
    path = folder() / "foreign.mcap"
    path.write_bytes(data)
    try:
        table = read_table(path)
    except CellwattError:
        return
    assert np.all(np.diff(table.time) > 0)


def seeds() -> Iterable[bytes]:
    """Joint states as JSON and as CDR that is cut short, in chunks and without."""
    for chunked in (True, False):
        file = io.BytesIO()
        writer = Writer(file, use_chunking=chunked, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="another")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"string[] name\nfloat64[] position\n")
        for encoding in ("json", "cdr"):
            channel = writer.register_channel(f"/{encoding}", encoding, schema)
            for i in range(4):
                said = {"header": {"stamp": {"sec": i, "nanosec": 5}}, "name": ["a", "b"], "position": [0.1 * i, 1.0]}
                data = json.dumps(said).encode() if encoding == "json" else b"\0\1\0\0\2\0\0\0"
                writer.add_message(channel, log_time=i, publish_time=i, data=data)
        writer.finish()  # type: ignore[no-untyped-call]
        yield file.getvalue()


TARGET = Target(run, seeds)
