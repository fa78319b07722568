from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from release.schemas import schemas

from cellwatt import Alarm, Energy, Event, Interval, Prediction, ProtocolError, Task
from cellwatt.outlets.zenoh.encode import decode, encode
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import TYPES, decode_item, encode_item, encode_json, health, topic_of
from cellwatt.outlets.zenoh.received import read_answer, read_health, read_sessions
from tests.daemon.outlets.zenoh.fake_cell import EPOCH, alarm, batch, sample

SCHEMAS = Path(__file__).resolve().parents[4] / "docs" / "schemas"
INTERVAL = Interval("arm", 3, EPOCH, EPOCH + 10, (1, 4), (0.5, -1.0), (0.0, 1.0), (0.75, 2.0), complete=False)
TASK = Task("arm", "task_1", "1-14", "speed=0.60", 0.6, EPOCH, EPOCH + 9, (1, 2, 3), 4)
PREDICTION = Prediction("power", 100, (1, 2), {"power": (1.5, 2.5)}, {"power": "W"})
SPLIT = {"electronics": 60.0, "brakes": 5.5, "unexplained": -0.25}
UNSURE = {"electronics": 0.25, "brakes": 0.125, "unexplained": 0.5}
ENERGY = Energy("arm", "task_1", "speed=0.60", 4, EPOCH, EPOCH + 9, 65.25, SPLIT, 0.5, 12.5, 19.2, 32.625, UNSURE)
EVENT = Event(EPOCH, None, "reloaded", "settings", {"sources": 2})
ITEMS: list[Any] = [INTERVAL, TASK, ENERGY, replace(ENERGY, total_per_part=None), PREDICTION, alarm(2), EVENT]
MARK = Mark(EPOCH, 17, 1, EPOCH)
DEEP = b"[" * 100_000


@pytest.mark.parametrize("item", ITEMS, ids=lambda i: type(i).__name__)
def test_results_survive_the_wire(item: Any) -> None:
    kind = topic_of(item).split("/")[0]
    payload = encode_item(item, MARK)
    assert decode_item(kind, payload) == item
    assert json.loads(payload)["mark"] == {"session": EPOCH, "sequence": 17}


def test_what_is_not_finite_is_null_and_comes_back_as_nan() -> None:
    found = decode_item("interval", encode_item(Interval("a", 1, 2, 3, (1,), (math.nan,), (math.inf,), (1.0,)), MARK))
    assert isinstance(found, Interval)
    assert math.isnan(found.displacement[0]) and math.isnan(found.pose[0])
    predicted = decode_item("prediction", encode_item(Prediction("m", 0, (1,), {"p": (math.nan,)}, {}), MARK))
    assert isinstance(predicted, Prediction) and math.isnan(predicted.outputs["p"][0])
    task = decode_item("task", encode_item(Task("a", "t", "s", "v", math.nan, 1, 2, (), 0), MARK))
    assert isinstance(task, Task) and math.isnan(task.speed)
    half = {"brakes": math.nan, "electronics": 1.0}
    odd = replace(ENERGY, total=math.nan, uncertainty=math.inf, groups=half, group_uncertainty=half)
    energy = decode_item("energy", encode_item(odd, MARK))
    assert isinstance(energy, Energy)
    assert math.isnan(energy.total) and math.isnan(energy.uncertainty)
    for groups in (energy.groups, energy.group_uncertainty):
        assert math.isnan(groups["brakes"]) and groups["electronics"] == 1.0


def test_an_energy_from_before_groups_had_uncertainties_is_read() -> None:
    body = json.loads(encode_item(ENERGY, MARK))
    del body["group_uncertainty"]
    assert decode_item("energy", encode_json(body)) == replace(ENERGY, group_uncertainty={})


def test_evidence_may_hold_what_stages_work_with() -> None:
    evidence = {"a_W": np.float64(1.5), "b": np.array([1.0, math.nan]), "c": np.int64(3), "d": Path("x"), "e": (1, 2)}
    payload = encode_item(Alarm("i", "k", "info", True, 1, 2, "s", evidence=evidence), MARK)
    assert json.loads(payload)["evidence"] == {"a_W": 1.5, "b": [1.0, None], "c": 3, "d": "x", "e": [1, 2]}


@pytest.mark.parametrize(
    ("kind", "payload"),
    [
        ("alarm", b""),
        ("alarm", b"{}"),
        ("alarm", encode_json({**json.loads(encode_item(alarm(1), MARK)), "severity": "fatal"})),
        ("prediction", b'{"outputs": []}'),
        ("energy", b'{"group_uncertainty": 3}'),
        ("speed", b"{}"),
        *product(("event", "interval", "alarm"), (DEEP, b'{"data":' + DEEP, b"[]", b"\xff", b"1e999")),
    ],
)
def test_messages_that_break_their_schema_are_refused(kind: str, payload: bytes) -> None:
    with pytest.raises(ProtocolError) as error:
        decode_item(kind, payload)
    assert len(str(error.value)) < 600
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("item", ITEMS, ids=lambda i: type(i).__name__)
def test_messages_have_the_fields_of_their_schema(item: Any) -> None:
    schema = schemas()[topic_of(item).split("/")[0]]
    assert set(json.loads(encode_item(item, MARK))) == set(schema["properties"]) >= set(schema["required"])


def test_health_has_the_fields_of_its_schema() -> None:
    body = json.loads(health(MARK, EPOCH + 1, {"frame": (EPOCH, 5)}, {"state": "green", "load": math.nan}))
    assert set(body) == set(schemas()["health"]["properties"])
    assert (body["positions"], body["status"]["load"]) == ({"frame": [EPOCH, 5]}, None)


@pytest.mark.parametrize("kind", [*TYPES, "health"])
def test_schema_in_the_docs_is_the_one_of_the_code(kind: str) -> None:
    command = "python release/schemas.py docs/schemas"
    assert json.loads((SCHEMAS / f"{kind}.json").read_text()) == schemas()[kind], f"run: {command}"


# Messages whose checksums are right and that are no use all the same: found by ``python -m fuzz`` ---


PLACE = Mark(1, 0, 1, 5)
SENT = pa.ipc.open_stream(encode(batch(0, 1))).read_next_batch()
ABOUT = json.loads(SENT.schema.metadata[b"cellwatt"])
TOLD = {"mark": {"session": 1, "sequence": 0}, "time": 1, "source": None, "kind": "k", "text": "t", "data": {}}


@pytest.mark.parametrize("number", [None, "0", 0.5, 1e999, 1 << 63, [], True])
def test_numbers_of_an_answer_that_are_none(number):
    answer = json.dumps([TOLD | {"mark": {"sequence": number}}]).encode()
    with pytest.raises(ProtocolError):
        read_answer(sample(answer, PLACE.encode(answer)), "event")
    for wrong in ({"time": number}, {"positions": {"frame": [1, number]}}):
        told = json.dumps({"session": 1, "time": 1, "positions": {}, "status": {}} | wrong).encode()
        with pytest.raises(ProtocolError):
            read_health(sample(told, PLACE.encode(told)))
    assert read_sessions(json.dumps([{"session": number}]).encode()) == []


def stream_of(rows: pa.RecordBatch) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, rows.schema) as writer:
        writer.write_batch(rows)
    return sink.getvalue().to_pybytes()


@pytest.mark.parametrize(
    "about",
    [
        DEEP.decode(),
        json.dumps(ABOUT | {"source": 5}),
        json.dumps(ABOUT | {"channels": [[name, 4.5, *more] for name, _, *more in ABOUT["channels"]]}),
        json.dumps({"format": "cellwatt.frames/1", "rate": 50.0, "channels": [["a.b", 4.5, "continuous", "linear"]]}),
    ],
)
def test_declarations_that_are_none(about):
    assert len(decode(stream_of(SENT), PLACE)) == 1
    with pytest.raises(ProtocolError) as error:
        decode(stream_of(SENT.replace_schema_metadata({"cellwatt": about})), PLACE)
    assert "\n" not in str(error.value) and "rows of" not in str(error.value)


def test_rows_of_any_length_are_none():
    values = pa.array([[0.5] * 3], pa.list_(pa.float64()))
    with pytest.raises(ProtocolError, match="rows of 3 channels"):
        decode(stream_of(SENT.set_column(4, "values", values)), PLACE)
