"""Batches and frames as Arrow IPC streams. Pure.

An answer is one complete Arrow stream: schema, one record batch, end. A live message is a record batch; the schema
precedes it in the first message, in one message per second after that, and after a consumer has asked for the cell's
status. The channels of a row are one fixed-size list, because sixty named columns take a hundred times as long; names,
units and kinds are JSON in the schema's metadata under ``cellwatt``. The bytes before the body are made once per
stream and number of rows; everything that differs between messages is in the mark, the message's attachment.

pyarrow is imported on first use, which saves 25 MB until a device delivers samples.
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
"""Zenoh encoding of all other messages."""
BATCH_FORMAT: Final = "cellwatt.batch/1"
FRAMES_FORMAT: Final = "cellwatt.frames/1"
_COLUMNS: Final = {
    Batch: (
        ("time", np.int64, False),
        ("device_time", np.int64, False),
        ("bound", np.int64, False),
        ("quality", np.uint8, False),
        ("values", np.float64, True),
    ),
    Frames: (
        ("time", np.int64, False),
        ("values", np.float64, True),
        ("quality", np.uint8, True),
        ("bound", np.int64, True),
    ),
}
"""Columns in order: (name, type, one value per channel). ``device_time`` may be null."""

_KEY: Final = b"cellwatt"
_END: Final = b"\xff\xff\xff\xff\x00\x00\x00\x00"
_KEPT: Final = 256
"""Most cached fronts, one per stream and number of rows."""
_LONGEST: Final = 512 * 1024
"""Most bytes of names and units; 1000 channels have some 60 kB. Parsed declarations are cached."""

_Declared = Stream | Layout


class _Front(NamedTuple):
    """The bytes before the columns of a message: the schema with its CRC-32, and the head of its record batch."""

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


def encode(block: Batch | Frames) -> bytes:
    """Encode a block as an Arrow stream; without a device clock, the device time of a batch is null."""
    front, columns = _parts(block)
    return b"".join((front.schema, front.head, *columns, _END))


def encode_apart(block: Batch | Frames) -> tuple[int, bytes, bytes]:
    """Encode a block as (CRC-32 of the schema, schema, record batch)."""
    front, columns = _parts(block)
    return front.check, front.schema, b"".join((front.head, *columns))


def schema_in(payload: bytes) -> bytes:
    """The schema at the beginning of a payload that ``decode`` has accepted."""
    return payload[: 8 + int.from_bytes(payload[4:8], "little")]


def _parts(block: Batch | Frames) -> tuple[_Front, Sequence[bytes]]:
    """Front and columns of a block."""
    n, timed = len(block), True
    of: _Declared
    if isinstance(block, Batch):
        of, source, timed = block.stream, block.source, block.device_time is not None
    else:
        of, source = block.layout, ""
    width = len(of.channels)
    columns = [
        _buffer(name, getattr(block, name), (n, width) if wide else (n,), dtype)
        for name, dtype, wide in _COLUMNS[type(block)]
    ]
    return _front(of, source, n, timed), columns


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
            return Frames(about, mark.sequence, **_arrays(table, Frames, len(about.channels)))
        source, stream = about
        return Batch(source, stream, mark.sequence, mark.arrival, **_arrays(table, Batch, len(stream.channels)))
    except (pa.ArrowException, ValueError, KeyError, TypeError, OSError, StopIteration, RecursionError) as error:
        reason = " ".join(str(error).split())[:LONGEST_REASON]
        raise ProtocolError(f"a message is not a cellwatt Arrow stream: {reason}") from error


def _padded(length: int) -> int:
    """Length in bytes of a buffer in a message body, with its padding."""
    return -(-length // 8) * 8


def _buffer(name: str, values: NDArray[Any] | None, shape: tuple[int, ...], dtype: Any) -> bytes:
    if values is None:
        return bytes(_padded(-(-shape[0] // 8)) + 8 * shape[0])
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
    """Make the front of a message: pyarrow encodes rows of zeros, and the zeros are removed."""
    import pyarrow as pa

    schema = _schema(of, source)
    columns = [pa.nulls(n, f.type) if f.nullable and not timed else _zeros(f.type, n) for f in schema]
    message = pa.RecordBatch.from_arrays(columns, schema=schema).serialize().to_pybytes()
    metadata = int.from_bytes(message[4:8], "little")
    begin = schema.serialize().to_pybytes()
    return _Front(of, begin, zlib.crc32(begin), message[: 8 + metadata])


def _zeros(kind: pa.DataType, n: int) -> Any:
    import pyarrow as pa

    # pyarrow.array would load pandas if it is installed.
    if isinstance(kind, pa.FixedSizeListType):
        return pa.Array.from_buffers(kind, n, [None], children=[_zeros(kind.value_type, n * kind.list_size)])
    return pa.Array.from_buffers(kind, n, [None, pa.py_buffer(bytes(n * kind.bit_width // 8))])


def _schema(of: _Declared, source: str) -> pa.Schema:
    import pyarrow as pa

    kind: type[Batch | Frames]
    about: dict[str, Any]
    if isinstance(of, Stream):
        kind, names = Batch, _CHANNEL
        about = {"format": BATCH_FORMAT, "source": source, "stream": of.name, "rate": of.rate, "clock": of.clock}
    else:
        kind, names, about = Frames, _FRAME_CHANNEL, {"format": FRAMES_FORMAT, "rate": of.rate}
    about["channels"] = [_told(channel, names) for channel in of.channels]
    fields = []
    for name, dtype, wide in _COLUMNS[kind]:
        plain = pa.from_numpy_dtype(dtype)
        whole = pa.list_(plain, len(of.channels)) if wide else plain
        fields.append(pa.field(name, whole, nullable=name == "device_time"))
    return pa.schema(fields, metadata={_KEY: json.dumps(about, separators=(",", ":"), ensure_ascii=False)})


def _told(channel: Channel | FrameChannel, names: Sequence[str]) -> list[Any]:
    """A channel as JSON-ready metadata; the window, if it has one, is last."""
    about = [getattr(channel, name) for name in names]
    return about if about[-1] else about[:-1]


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


def _arrays(table: Any, kind: type[Batch | Frames], width: int) -> dict[str, Any]:
    """The arrays of a message of ``width`` channels, by name."""
    found: dict[str, Any] = {}
    for name, dtype, wide in _COLUMNS[kind]:
        column = table.column(name)
        if column.null_count and name == "device_time":
            found[name] = None
        else:
            found[name] = _matrix(column, width, dtype) if wide else _numbers(column, dtype)
    return found


def _numbers(column: Any, dtype: Any) -> NDArray[Any]:
    found: NDArray[Any] = column.to_numpy(zero_copy_only=True)
    if found.dtype != dtype:
        raise ValueError(f"expected a column of {np.dtype(dtype)}, found {found.dtype}")
    return found


def _matrix(column: Any, width: int, dtype: Any) -> NDArray[Any]:
    if getattr(column.type, "list_size", None) != width:  # lists of variable length lack it
        raise ValueError(f"expected rows of {width} channels, found {column.type}")
    return _numbers(column.values, dtype).reshape(len(column), width)
