"""Batches and frames as Arrow IPC streams, and the mark that travels with every message. Pure.

A payload is one whole Arrow stream: schema, one record batch, end. Few columns, because sixty named ones cost a
hundred times the time: the channels of a row are one fixed-size list, their names, units and kinds are JSON in the
schema's metadata under ``cellwatt``. The schema's bytes are made once per stream; what differs from message to
message is in the mark, which travels as the attachment.

pyarrow is imported on first use: a daemon whose devices are all down does without its 25 MB.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from cellwatt.batch import Batch
from cellwatt.channel import Channel, Stream
from cellwatt.errors import ProtocolError
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.publish.mark import Mark

if TYPE_CHECKING:
    import pyarrow as pa

ARROW: Final = "application/vnd.apache.arrow.stream"
"""Zenoh encoding of batches and frames."""
JSON: Final = "application/json"
"""Zenoh encoding of all else."""
BATCH_FORMAT: Final = "cellwatt.batch/1"
FRAMES_FORMAT: Final = "cellwatt.frames/1"
_BATCH_COLUMNS: Final = ("time", "device_time", "bound", "quality", "values")
_FRAMES_COLUMNS: Final = ("time", "values", "quality", "bound")

_KEY: Final = b"cellwatt"
_END: Final = b"\xff\xff\xff\xff\x00\x00\x00\x00"
_KEPT: Final = 256
"""Schemas kept ready, one a stream."""

_ready: dict[tuple[int, str], tuple[Stream | Layout, Any, bytes]] = {}
_Declared = TypeVar("_Declared", Stream, Layout)


def encode_batch(batch: Batch) -> bytes:
    """A batch as an Arrow stream: columns time, device_time (null without a device clock), bound, quality, values."""
    import pyarrow as pa

    n, width = len(batch), len(batch.stream.channels)
    schema, head = _schema(batch.stream, batch.source, _batch_schema)
    device = (
        pa.nulls(n, pa.int64()) if batch.device_time is None else _column(pa.int64(), n, batch.device_time, np.int64)
    )
    columns = [
        _column(pa.int64(), n, batch.time, np.int64),
        device,
        _column(pa.int64(), n, batch.bound, np.int64),
        _column(pa.uint8(), n, batch.quality, np.uint8),
        _rows(schema, "values", n, width, batch.values, np.float64),
    ]
    return _message(schema, head, columns)


def encode_frames(frames: Frames) -> bytes:
    """Frames as an Arrow stream: columns time, values, quality, bound."""
    n, width = len(frames), len(frames.layout.channels)
    schema, head = _schema(frames.layout, "", _frames_schema)
    columns = [
        _column(schema.field("time").type, n, frames.time, np.int64),
        _rows(schema, "values", n, width, frames.values, np.float64),
        _rows(schema, "quality", n, width, frames.quality, np.uint8),
        _rows(schema, "bound", n, width, frames.bound, np.int64),
    ]
    return _message(schema, head, columns)


def decode(payload: bytes, mark: Mark) -> Batch | Frames:
    """A batch or frames from a message. Raises ``ProtocolError`` where the payload is neither.

    The arrays look into ``payload`` and are read-only.
    """
    import pyarrow as pa

    try:
        table = pa.ipc.open_stream(payload).read_next_batch()
        table.validate(full=True)
        if table.num_rows != mark.count:
            raise ValueError(f"{table.num_rows} rows, but {mark.count} are announced")
        about = _about((table.schema.metadata or {}).get(_KEY, b"{}"))
        if isinstance(about, Layout):
            return _to_frames(table, about, mark)
        return _to_batch(table, *about, mark)
    except (pa.ArrowException, ValueError, KeyError, TypeError, OSError, StopIteration) as error:
        raise ProtocolError(f"a message is not a cellwatt Arrow stream: {error}") from error


def named(content: Batch | Frames) -> pa.Table:
    """A table with one named column a channel, unit and kind in the field's metadata.

    Before the channels: ``time`` (UTC), and of a batch ``device_time``, ``bound``, ``quality``.
    """
    import pyarrow as pa

    fields = [pa.field("time", pa.timestamp("ns", tz="UTC"))]
    columns: list[Any] = [pa.array(content.time).cast(fields[0].type)]
    if isinstance(content, Batch):
        device = content.device_time
        columns += [pa.nulls(len(content), pa.int64()) if device is None else pa.array(device)]
        columns += [pa.array(content.bound), pa.array(content.quality)]
        fields += [pa.field("device_time", pa.int64()), pa.field("bound", pa.int64()), pa.field("quality", pa.uint8())]
    channels: Sequence[Channel | FrameChannel] = (
        content.stream.channels if isinstance(content, Batch) else content.layout.channels
    )
    for i, channel in enumerate(channels):
        about = {"unit": channel.unit, "kind": channel.kind, "method": channel.method}
        fields.append(pa.field(channel.name, pa.float64(), metadata=about))
        columns.append(pa.array(np.ascontiguousarray(content.values[:, i])))
    return pa.table(columns, schema=pa.schema(fields))


def _message(schema: pa.Schema, head: bytes, columns: list[Any]) -> bytes:
    import pyarrow as pa

    body = pa.RecordBatch.from_arrays(columns, schema=schema).serialize()
    return b"".join((head, body, _END))


def _column(kind: Any, n: int, values: NDArray[Any], dtype: Any) -> Any:
    import pyarrow as pa

    if values.shape != (n,):
        raise ValueError(f"expected {n} values, found an array of {values.shape}")
    return pa.Array.from_buffers(kind, n, [None, pa.py_buffer(np.ascontiguousarray(values, dtype))])


def _rows(schema: pa.Schema, name: str, n: int, width: int, values: NDArray[Any], dtype: Any) -> Any:
    import pyarrow as pa

    if values.shape != (n, width):
        raise ValueError(f"{name}: expected an array of ({n}, {width}), found {values.shape}")
    kind = schema.field(name).type
    inner = pa.Array.from_buffers(kind.value_type, n * width, [None, pa.py_buffer(np.ascontiguousarray(values, dtype))])
    return pa.Array.from_buffers(kind, n, [None], children=[inner])


def _schema(of: _Declared, source: str, make: Callable[[_Declared, str], pa.Schema]) -> tuple[pa.Schema, bytes]:
    """The schema of a stream or layout and its bytes, made once.

    Looked up by identity: hashing sixty channels costs as much as encoding a batch.
    """
    ready = _ready.get((id(of), source))
    if ready is None or ready[0] is not of:
        if len(_ready) >= _KEPT:
            _ready.clear()
        schema = make(of, source)
        ready = _ready[id(of), source] = (of, schema, schema.serialize().to_pybytes())
    return ready[1:]


def _batch_schema(stream: Stream, source: str) -> pa.Schema:
    import pyarrow as pa

    about = {
        "format": BATCH_FORMAT,
        "source": source,
        "stream": stream.name,
        "rate": stream.rate,
        "clock": stream.clock,
        "channels": [_told([c.name, c.unit, c.kind, c.align, c.window]) for c in stream.channels],
    }
    columns = [
        pa.field("time", pa.int64(), nullable=False),
        pa.field("device_time", pa.int64()),
        pa.field("bound", pa.int64(), nullable=False),
        pa.field("quality", pa.uint8(), nullable=False),
        pa.field("values", pa.list_(pa.float64(), len(stream.channels)), nullable=False),
    ]
    return pa.schema(columns, metadata={_KEY: json.dumps(about, separators=(",", ":"), ensure_ascii=False)})


def _told(about: list[Any]) -> list[Any]:
    """What is said of a channel; its window, which comes last, only where there is one."""
    return about if about[-1] else about[:-1]


def _frames_schema(layout: Layout, _: str) -> pa.Schema:
    import pyarrow as pa

    about = {
        "format": FRAMES_FORMAT,
        "rate": layout.rate,
        "channels": [_told([c.name, c.unit, c.kind, c.method, c.window]) for c in layout.channels],
    }
    width = len(layout.channels)
    columns = [
        pa.field("time", pa.int64(), nullable=False),
        pa.field("values", pa.list_(pa.float64(), width), nullable=False),
        pa.field("quality", pa.list_(pa.uint8(), width), nullable=False),
        pa.field("bound", pa.list_(pa.int64(), width), nullable=False),
    ]
    return pa.schema(columns, metadata={_KEY: json.dumps(about, separators=(",", ":"), ensure_ascii=False)})


@lru_cache(maxsize=_KEPT)
def _about(metadata: bytes) -> Layout | tuple[str, Stream]:
    about = json.loads(metadata)
    if about["format"] == FRAMES_FORMAT:
        return Layout(tuple(FrameChannel(*c) for c in about["channels"]), about["rate"])
    if about["format"] != BATCH_FORMAT:
        raise ValueError(f"unknown format {about['format']!r}")
    channels = tuple(Channel(*c) for c in about["channels"])
    return about["source"], Stream(about["stream"], channels, about["rate"], about["clock"])


def _to_batch(table: Any, source: str, stream: Stream, mark: Mark) -> Batch:
    time, device, bound, quality, values = (table.column(name) for name in _BATCH_COLUMNS)
    return Batch(
        source=source,
        stream=stream,
        sequence=mark.sequence,
        arrival=mark.arrival,
        time=_numbers(time, np.int64),
        bound=_numbers(bound, np.int64),
        values=_matrix(values, len(stream.channels), np.float64),
        quality=_numbers(quality, np.uint8),
        device_time=None if device.null_count else _numbers(device, np.int64),
    )


def _to_frames(table: Any, layout: Layout, mark: Mark) -> Frames:
    time, values, quality, bound = (table.column(name) for name in _FRAMES_COLUMNS)
    width = len(layout.channels)
    return Frames(
        layout=layout,
        sequence=mark.sequence,
        time=_numbers(time, np.int64),
        values=_matrix(values, width, np.float64),
        quality=_matrix(quality, width, np.uint8),
        bound=_matrix(bound, width, np.int64),
    )


def _numbers(column: Any, dtype: Any) -> NDArray[Any]:
    found: NDArray[Any] = column.to_numpy(zero_copy_only=True)
    if found.dtype != dtype:
        raise ValueError(f"expected a column of {np.dtype(dtype)}, found {found.dtype}")
    return found


def _matrix(column: Any, width: int, dtype: Any) -> NDArray[Any]:
    if column.type.list_size != width:
        raise ValueError(f"expected rows of {width} channels, found {column.type}")
    return _numbers(column.values, dtype).reshape(len(column), width)
