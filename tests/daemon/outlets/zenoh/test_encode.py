from __future__ import annotations

import json
import zlib
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cellwatt import Batch, Channel, Frames, Layout, ProtocolError, Stream
from cellwatt.frames import concatenate, cut, follows, join
from cellwatt.outlets.zenoh.encode import decode, encode, encode_apart, schema_in
from cellwatt.outlets.zenoh.mark import Mark
from tests.daemon.outlets.zenoh.fake_cell import HOST_STREAM, batch, frames

INT64 = st.integers(-(2**63), 2**63 - 1)


def mark_of(block: Batch | Frames, arrival: int = 7) -> Mark:
    return Mark(1, block.sequence, len(block), arrival)


def assert_same(found: Batch | Frames | None, expected: Batch | Frames) -> None:
    assert type(found) is type(expected)
    for name in expected.__dataclass_fields__:
        mine, other = getattr(found, name), getattr(expected, name)
        if isinstance(other, np.ndarray):
            assert mine.dtype == other.dtype
            np.testing.assert_array_equal(mine, other)
        else:
            assert mine == other, name


@st.composite
def batches(draw: st.DrawFn) -> Batch:
    n, width = draw(st.integers(0, 20)), draw(st.integers(1, 70))
    names = st.text(min_size=1, max_size=8)
    kinds, windows = st.sampled_from(["continuous", "counter"]), st.sampled_from([0.0, 0.1])
    channels = tuple(Channel(draw(names), "W", draw(kinds), window=draw(windows)) for _ in range(width))
    stream = Stream(draw(names), channels, draw(st.floats(0, 1e4)), draw(st.sampled_from(["device", "host"])))
    numbers = hnp.arrays(np.int64, n, elements=INT64)
    return Batch(
        source=draw(names),
        stream=stream,
        sequence=draw(st.integers(0, 2**62)),
        arrival=draw(INT64),
        time=draw(numbers),
        bound=draw(numbers),
        values=draw(hnp.arrays(np.float64, (n, width))),
        quality=draw(hnp.arrays(np.uint8, n)),
        device_time=draw(st.none() | numbers),
    )


@given(batches())
@settings(max_examples=60, deadline=None)
def test_batch_survives_the_wire(made: Batch) -> None:
    found = decode(encode(made), mark_of(made, made.arrival))
    if not len(made):
        made = replace(made, device_time=found.device_time)  # type: ignore[union-attr]
    assert_same(found, made)


def test_frames_survive_the_wire() -> None:
    made = frames(40, 7)
    slow = replace(made.layout.channels[0], method="hold", window=0.1)
    made = replace(made, layout=Layout((slow, *made.layout.channels[1:]), made.layout.rate))
    assert_same(decode(encode(made), mark_of(made)), made)


def test_views_and_columns_in_any_memory_order_are_encoded_as_seen() -> None:
    whole = batch(0, 20)
    fortran = replace(whole, values=np.asfortranarray(whole.values))
    assert encode(fortran) == encode(whole)
    assert_same(decode(encode(cut(whole, 3, 9)), Mark(1, 3, 6, whole.arrival)), cut(whole, 3, 9))


def test_a_payload_is_a_whole_arrow_stream_for_those_who_know_nothing_of_us() -> None:
    made = batch(10, 4)
    table = pa.ipc.open_stream(encode(made)).read_all()
    assert table.column_names == ["time", "device_time", "bound", "quality", "values"]
    about = json.loads(table.schema.metadata[b"cellwatt"])
    assert about["format"] == "cellwatt.batch/1"
    assert (about["source"], about["stream"], about["rate"], about["clock"]) == ("arm", "samples", 500.0, "device")
    assert about["channels"][1] == ["supply.power", "W", "continuous", None]
    assert table["values"].to_pylist()[2] == [12.0, 12.1, 12.2]
    assert table["device_time"].to_pylist() == [20_000_000, 22_000_000, 24_000_000, 26_000_000]


def test_streams_of_one_name_are_not_mixed_up() -> None:
    """The schema is kept by the identity of a stream; another stream at the same address must not get it."""
    for width in range(1, 300):
        stream = Stream("s", tuple(Channel(f"c{i}", "W") for i in range(width % 7 + 1)), 1.0, "host")
        found = decode(encode(batch(0, 1, "x", stream)), Mark(1, 0, 1, 0))
        assert isinstance(found, Batch)
        assert found.stream == stream


@pytest.mark.parametrize("payload", [b"", b"x", b"\xff\xff\xff\xff\x00\x00\x00\x00", b'{"json": true}' * 9])
def test_foreign_payloads_are_refused(payload: bytes) -> None:
    with pytest.raises(ProtocolError, match="not a cellwatt Arrow stream"):
        decode(payload, Mark(1, 0, 1, 0))


@given(st.data())
@settings(max_examples=300, deadline=None)
def test_damaged_payloads_never_do_worse_than_be_refused(data: st.DataObject) -> None:
    payload = bytearray(encode(batch(0, 3)))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    payload = payload[: data.draw(st.integers(len(payload) // 2, len(payload)))]
    try:
        found = decode(bytes(payload), Mark(1, 0, 3, 0))
    except ProtocolError:
        return
    assert len(found) == 3
    assert found.values.shape[0] == 3


def test_mark_is_36_little_endian_bytes_as_documented() -> None:
    mark = Mark(0x0102030405060708, 0x1112, 0x21222324, -1, backfill=True)
    expected = bytes.fromhex("010100002423222108070605040302011211000000000000ffffffffffffffff3b6e795b")
    assert mark.encode(b"payload") == expected, "its end is the CRC-32 of the bytes before it and of the payload"
    assert Mark.decode(expected, b"payload") == mark
    assert mark.end == 0x1112 + 0x21222324


def test_a_mark_of_a_message_without_its_schema_names_it_as_documented() -> None:
    mark = Mark(0x0102030405060708, 0x1112, 0x21222324, -1, schema=0x31323334)
    head = bytes.fromhex("020000002423222108070605040302011211000000000000ffffffffffffffff34333231")
    expected = head + bytes.fromhex("76505e6a")
    assert mark.encode(b"payload") == expected
    assert Mark.decode(expected + bytes(64), b"payload") == mark  # a signature follows
    with pytest.raises(ProtocolError, match="checksum"):
        Mark.decode(expected, b"payloae")
    for short in (head[:-1], head, expected[:-1]):
        with pytest.raises(ProtocolError, match="version 1 or 2"):
            Mark.decode(short, b"payload")


@pytest.mark.parametrize("block", [batch(0, 3), batch(0, 2, "meter", HOST_STREAM), frames(0, 4)])
def test_schema_and_record_batch_are_the_pieces_of_the_stream(block: Batch | Frames) -> None:
    check, schema, rows = encode_apart(block)
    whole = encode(block)
    assert whole == schema + rows + b"\xff\xff\xff\xff\0\0\0\0"
    assert schema_in(schema + rows) == schema
    assert check == zlib.crc32(schema)
    read = pa.ipc.read_record_batch(rows, pa.ipc.read_schema(pa.py_buffer(schema)))
    assert read["time"].to_pylist() == block.time.tolist()


@settings(deadline=None)
@given(INT64, st.integers(0, 2**62), st.integers(0, 2**32 - 1), INT64, st.booleans())
def test_marks_survive(session: int, sequence: int, count: int, arrival: int, backfill: bool) -> None:
    mark = Mark(session, sequence, count, arrival, backfill)
    assert Mark.decode(mark.encode(b"x") + b"a later version may say more", b"x") == mark


@settings(deadline=None)
@given(st.binary(min_size=1, max_size=400), st.data())
def test_damage_of_a_message_is_noticed(payload: bytes, data: st.DataObject) -> None:
    attachment = bytearray(Mark(1, 2, 3, 4).encode(payload))
    damaged = bytearray(payload)
    where = data.draw(st.sampled_from([damaged, attachment]))
    first = data.draw(st.integers(0, len(where) - 1))
    for place in range(first, min(first + data.draw(st.integers(1, 4)), len(where))):
        where[place] ^= data.draw(st.integers(1, 255))
    with pytest.raises(ProtocolError):
        Mark.decode(bytes(attachment), bytes(damaged))


def test_blocks_join_up_to_a_hole_and_a_limit() -> None:
    blocks = [batch(0, 4), batch(4, 4), batch(9, 4)]
    for limit, count in ((100, 8), (5, 5)):
        assert_same(join(blocks, limit), replace(batch(0, count), arrival=blocks[1].arrival))
    assert join([], 5) is None
    assert not follows(batch(0, 2), batch(2, 2, "meter", HOST_STREAM))
    assert not follows(batch(0, 2), replace(batch(2, 2), device_time=None))
    assert_same(concatenate([frames(0, 3), frames(3, 1)]), frames(0, 4))
