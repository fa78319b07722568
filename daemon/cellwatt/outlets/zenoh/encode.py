"""Batches and frames as Arrow IPC streams, and the mark that travels with every message. Pure.

An answer is one whole Arrow stream: schema, one record batch, end. A live message is a record batch; before it comes
the schema in the first one, in one a second after that, and once a consumer has asked for the cell's status. The
channels of a row are one fixed-size list, because sixty named columns take a hundred times as long; names, units and
kinds are JSON in the schema's metadata under ``cellwatt``. The bytes before the body are made once per stream and
number of rows; all that differs between messages is in the mark, which travels as the attachment.

pyarrow is imported on first use, which saves 25 MB while no device delivers.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import pydantic_core
from numpy.typing import NDArray
from pydantic import TypeAdapter

from cellwatt.batch import Batch
from cellwatt.channel import Channel, Stream
from cellwatt.errors import ProtocolError
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import LONGEST_REASON
from cellwatt.outlets.zenoh.packed import refuse_packed

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
"""Fronts kept ready: one a stream and number of rows."""
_LONGEST: Final = 512 * 1024
"""Bytes of names and units; 1000 channels have some 60 kB. What is read of them is kept."""

_Declared = Stream | Layout


class _Front(NamedTuple):
    """What precedes the columns of a message: the schema with its CRC-32, and the head of its record batch."""

    of: _Declared
    schema: bytes
    check: int
    head: bytes


_ready: dict[tuple[int, str, int, bool], _Front] = {}
_CHANNEL: Final = ("name", "unit", "kind", "align", "window")
_FRAME_CHANNEL: Final = ("name", "unit", "kind", "method", "window")
"""Fields of a channel's declaration, in order."""
_STREAM: Final[TypeAdapter[Stream]] = TypeAdapter(Stream)
_LAYOUT: Final[TypeAdapter[Layout]] = TypeAdapter(Layout)


def encode_batch(batch: Batch) -> bytes:
    """Encode a batch as an Arrow stream: time, device_time (null without a device clock), bound, quality, values."""
    return _whole(*_batch(batch))


def encode_frames(frames: Frames) -> bytes:
    """Encode frames as an Arrow stream: time, values, quality, bound."""
    return _whole(*_frames(frames))


def encode_apart(block: Batch | Frames) -> tuple[int, bytes, bytes]:
    """Encode a block in two: its schema, after the CRC-32 of that, and its record batch."""
    front, columns = _batch(block) if isinstance(block, Batch) else _frames(block)
    return front.check, front.schema, b"".join((front.head, *columns))


def schema_in(payload: bytes) -> bytes:
    """The schema with which a payload begins that ``decode`` has accepted."""
    return payload[: 8 + int.from_bytes(payload[4:8], "little")]


def _whole(front: _Front, columns: Sequence[bytes]) -> bytes:
    return b"".join((front.schema, front.head, *columns, _END))


def _batch(batch: Batch) -> tuple[_Front, Sequence[bytes]]:
    n, width, device = len(batch), len(batch.stream.channels), batch.device_time
    columns = [
        _buffer("time", batch.time, (n,), np.int64),
        bytes(_padded(-(-n // 8)) + 8 * n) if device is None else _buffer("device_time", device, (n,), np.int64),
        _buffer("bound", batch.bound, (n,), np.int64),
        _buffer("quality", batch.quality, (n,), np.uint8),
        _buffer("values", batch.values, (n, width), np.float64),
    ]
    return _front(batch.stream, batch.source, n, device is not None), columns


def _frames(frames: Frames) -> tuple[_Front, Sequence[bytes]]:
    n, width = len(frames), len(frames.layout.channels)
    columns = [
        _buffer("time", frames.time, (n,), np.int64),
        _buffer("values", frames.values, (n, width), np.float64),
        _buffer("quality", frames.quality, (n, width), np.uint8),
        _buffer("bound", frames.bound, (n, width), np.int64),
    ]
    return _front(frames.layout, "", n, True), columns


def decode(payload: bytes, mark: Mark) -> Batch | Frames:
    """Decode a message into a batch or frames. Raises ``ProtocolError`` if the payload is neither.

    The arrays are read-only views of ``payload``.
    """
    import pyarrow as pa

    try:
        refuse_packed(payload)
        table = pa.ipc.open_stream(payload).read_next_batch()
        table.validate(full=True)
        if table.num_rows != mark.count:
            raise ValueError(f"{table.num_rows} rows, but {mark.count} are announced")
        metadata = (table.schema.metadata or {}).get(_KEY, b"{}")
        if len(metadata) > _LONGEST:
            raise ValueError(f"its channels take {len(metadata)} bytes to name")
        about = _about(metadata)
        if isinstance(about, Layout):
            return _to_frames(table, about, mark)
        return _to_batch(table, *about, mark)
    except (pa.ArrowException, ValueError, KeyError, TypeError, OSError, StopIteration, RecursionError) as error:
        reason = " ".join(str(error).split())[:LONGEST_REASON]
        raise ProtocolError(f"a message is not a cellwatt Arrow stream: {reason}") from error


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


def _padded(length: int) -> int:
    """Length in bytes of a buffer in a message body, with its padding."""
    return -(-length // 8) * 8


def _buffer(name: str, values: NDArray[Any], shape: tuple[int, ...], dtype: Any) -> bytes:
    if values.shape != shape:
        raise ValueError(f"{name}: expected an array of {shape}, found {values.shape}")
    data = np.ascontiguousarray(values, dtype).tobytes()
    return data + bytes(_padded(len(data)) - len(data))


def _front(of: _Declared, source: str, n: int, timed: bool) -> _Front:
    """The bytes of a message before its body, which depend only on the schema and the number of rows.

    Looked up by identity: hashing sixty channels costs as much as encoding a batch.
    """
    key = id(of), source, n, timed
    ready = _ready.get(key)
    if ready is None or ready.of is not of:
        if len(_ready) >= _KEPT:
            _ready.clear()
        ready = _ready[key] = _make_front(of, source, n, timed)
    return ready


def _make_front(of: _Declared, source: str, n: int, timed: bool) -> _Front:
    """Make the front of a message: pyarrow writes rows of zeros, and the zeros are cut off."""
    import pyarrow as pa

    schema = _batch_schema(of, source) if isinstance(of, Stream) else _frames_schema(of)
    columns = [pa.nulls(n, f.type) if f.nullable and not timed else _zeros(f.type, n) for f in schema]
    message = pa.RecordBatch.from_arrays(columns, schema=schema).serialize().to_pybytes()
    metadata = int.from_bytes(message[4:8], "little")
    begin = schema.serialize().to_pybytes()
    return _Front(of, begin, zlib.crc32(begin), message[: 8 + metadata])


def _zeros(kind: pa.DataType, n: int) -> Any:
    import pyarrow as pa

    # pyarrow.array would load pandas where there is one.
    if isinstance(kind, pa.FixedSizeListType):
        return pa.Array.from_buffers(kind, n, [None], children=[_zeros(kind.value_type, n * kind.list_size)])
    return pa.Array.from_buffers(kind, n, [None, pa.py_buffer(bytes(n * kind.bit_width // 8))])


def _batch_schema(stream: Stream, source: str) -> pa.Schema:
    import pyarrow as pa

    about = {
        "format": BATCH_FORMAT,
        "source": source,
        "stream": stream.name,
        "rate": stream.rate,
        "clock": stream.clock,
        "channels": [_told(c, _CHANNEL) for c in stream.channels],
    }
    columns = [
        pa.field("time", pa.int64(), nullable=False),
        pa.field("device_time", pa.int64()),
        pa.field("bound", pa.int64(), nullable=False),
        pa.field("quality", pa.uint8(), nullable=False),
        pa.field("values", pa.list_(pa.float64(), len(stream.channels)), nullable=False),
    ]
    return pa.schema(columns, metadata={_KEY: json.dumps(about, separators=(",", ":"), ensure_ascii=False)})


def _told(channel: Channel | FrameChannel, names: Sequence[str]) -> list[Any]:
    """A channel as JSON-ready metadata; its window comes last, and only if it has one."""
    about = [getattr(channel, name) for name in names]
    return about if about[-1] else about[:-1]


def _frames_schema(layout: Layout) -> pa.Schema:
    import pyarrow as pa

    about = {
        "format": FRAMES_FORMAT,
        "rate": layout.rate,
        "channels": [_told(c, _FRAME_CHANNEL) for c in layout.channels],
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
    about = pydantic_core.from_json(metadata)
    if about["format"] == FRAMES_FORMAT:
        columns = [dict(zip(_FRAME_CHANNEL, column, strict=False)) for column in about["channels"]]
        return _LAYOUT.validate_python({"channels": columns, "rate": about["rate"]})
    if about["format"] != BATCH_FORMAT or not isinstance(about["source"], str):
        raise ValueError(f"unknown format {str(about['format'])[:40]!r}")
    channels = [dict(zip(_CHANNEL, channel, strict=False)) for channel in about["channels"]]
    plain = {"name": about["stream"], "channels": channels, "rate": about["rate"], "clock": about["clock"]}
    return about["source"], _STREAM.validate_python(plain)


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
    if getattr(column.type, "list_size", None) != width:  # which lists of any length lack
        raise ValueError(f"expected rows of {width} channels, found {column.type}")
    return _numbers(column.values, dtype).reshape(len(column), width)
