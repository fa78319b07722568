"""Messages whose checksums are right and that are no use all the same: found by ``python -m fuzz``."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pyarrow as pa
import pytest

from cellwatt.errors import ProtocolError
from cellwatt.outlets.zenoh.encode import decode
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import decode_item
from cellwatt.outlets.zenoh.received import read_answer, read_health, read_refusal, read_sessions

DEEP = b"[" * 100_000
MARK = Mark(1, 0, 1, 5)
ABOUT = {
    "format": "cellwatt.batch/1",
    "source": "arm",
    "stream": "rtde",
    "rate": 500.0,
    "clock": "device",
    "channels": [["joint_1.position", "rad", "continuous", None]],
}
EVENT = {"mark": {"session": 1, "sequence": 0}, "time": 1, "source": None, "kind": "k", "text": "t", "data": {}}


def sample(payload: bytes):
    def holding(data):
        return SimpleNamespace(to_bytes=lambda: data)

    return SimpleNamespace(payload=holding(payload), attachment=holding(MARK.encode(payload)))


@pytest.mark.parametrize("payload", [DEEP, b'{"data":' + DEEP, b"[]", b"\xff", b"1e999"])
def test_json_that_is_no_result(payload):
    for kind in ("event", "interval", "alarm"):
        with pytest.raises(ProtocolError) as error:
            decode_item(kind, payload)
        assert len(str(error.value)) < 500
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("number", [None, "0", 0.5, 1e999, 1 << 63, [], True])
def test_numbers_of_an_answer_that_are_none(number):
    answer = json.dumps([EVENT | {"mark": {"sequence": number}}]).encode()
    with pytest.raises(ProtocolError):
        read_answer(sample(answer), "event")
    with pytest.raises(ProtocolError):
        read_health(sample(json.dumps({"session": 1, "time": number, "positions": {}, "status": {}}).encode()))
    with pytest.raises(ProtocolError):
        told = {"session": 1, "time": 1, "positions": {"frame": [1, number]}, "status": {}}
        read_health(sample(json.dumps(told).encode()))
    assert read_sessions(json.dumps([{"session": number}]).encode()) == []


def test_an_answer_that_is_one_is_read():
    ((mark, event),) = read_answer(sample(json.dumps([EVENT]).encode()), "event")
    assert (mark.sequence, event.text) == (0, "t")


def test_nested_beyond_all_sense():
    with pytest.raises(ProtocolError):
        read_answer(sample(DEEP), "event")
    with pytest.raises(ProtocolError):
        read_health(sample(DEEP))
    assert read_sessions(DEEP) == []
    assert read_refusal(SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: DEEP))) is None


def stream_of(about: str, values: pa.Array | None = None) -> bytes:
    columns = {
        "time": pa.array([1], pa.int64()),
        "device_time": pa.nulls(1, pa.int64()),
        "bound": pa.array([0], pa.int64()),
        "quality": pa.array([0], pa.uint8()),
        "values": pa.array([[0.5]], pa.list_(pa.float64(), 1)) if values is None else values,
    }
    batch = pa.record_batch(columns).replace_schema_metadata({"cellwatt": about})
    outlet = pa.BufferOutputStream()
    with pa.ipc.new_stream(outlet, batch.schema) as writer:
        writer.write_batch(batch)
    return outlet.getvalue().to_pybytes()


def test_an_arrow_stream_that_is_one_is_read():
    batch = decode(stream_of(json.dumps(ABOUT)), MARK)
    assert batch.values.tolist() == [[0.5]]


@pytest.mark.parametrize(
    "about",
    [
        DEEP.decode(),
        "5",
        json.dumps(ABOUT | {"source": 5}),
        json.dumps(ABOUT | {"stream": None}),
        json.dumps(ABOUT | {"rate": "fast"}),
        json.dumps(ABOUT | {"clock": "none"}),
        json.dumps(ABOUT | {"channels": [["joint_1.position", 4.5, "continuous", None]]}),
        json.dumps(ABOUT | {"channels": [["joint_1.position", "rad", "odd", None]]}),
        json.dumps(ABOUT | {"channels": [[["a"], "rad"]]}),
        json.dumps({"format": "cellwatt.frames/1", "rate": 50.0, "channels": [["a.b", 4.5, "continuous", "linear"]]}),
    ],
)
def test_declarations_that_are_none(about):
    with pytest.raises(ProtocolError) as error:
        decode(stream_of(about), MARK)
    assert "\n" not in str(error.value)


def test_rows_of_any_length_are_none():
    with pytest.raises(ProtocolError, match="rows of 1 channels"):
        decode(stream_of(json.dumps(ABOUT), pa.array([[0.5]], pa.list_(pa.float64()))), MARK)
