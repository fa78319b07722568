from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from schemas import schemas, write

from cellwatt import Alarm, Energy, Event, Interval, Prediction, ProtocolError, Task
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import TYPES, decode_item, encode_item, encode_json, health, topic_of
from tests.daemon.outlets.zenoh.fake_cell import EPOCH, alarm

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


@pytest.mark.parametrize("item", ITEMS, ids=lambda i: type(i).__name__)
def test_results_survive_the_wire(item: Any) -> None:
    kind = topic_of(item).split("/")[0]
    payload = encode_item(item, MARK)
    assert decode_item(kind, payload) == item
    assert json.loads(payload)["mark"] == {"session": EPOCH, "sequence": 17}


def test_alarm_is_the_object_that_the_docs_show() -> None:
    assert json.loads(encode_item(alarm(2), MARK)) == {
        "mark": {"session": EPOCH, "sequence": 17},
        "id": "alarm-2",
        "kind": "joint_fault",
        "severity": "error",
        "active": True,
        "since": EPOCH,
        "time": EPOCH + 2,
        "statement": "Joint 2 needs more power than it should.",
        "source": None,
        "joint": 2,
        "alternatives": [],
        "interval": None,
        "evidence": {"residual_W": 12.5},
        "stage": None,
    }


def test_what_is_not_finite_is_null_and_comes_back_as_nan() -> None:
    found = decode_item("interval", encode_item(Interval("a", 1, 2, 3, (1,), (math.nan,), (math.inf,), (1.0,)), MARK))
    assert isinstance(found, Interval)
    assert math.isnan(found.displacement[0])
    assert math.isnan(found.pose[0])
    predicted = decode_item("prediction", encode_item(Prediction("m", 0, (1,), {"p": (math.nan,)}, {}), MARK))
    assert isinstance(predicted, Prediction)
    assert math.isnan(predicted.outputs["p"][0])
    task = decode_item("task", encode_item(Task("a", "t", "s", "v", math.nan, 1, 2, (), 0), MARK))
    assert isinstance(task, Task)
    assert math.isnan(task.speed)
    half = {"brakes": math.nan, "electronics": 1.0}
    odd = replace(ENERGY, total=math.nan, uncertainty=math.inf, groups=half, group_uncertainty=half)
    energy = decode_item("energy", encode_item(odd, MARK))
    assert isinstance(energy, Energy)
    assert math.isnan(energy.total)
    assert math.isnan(energy.uncertainty)
    assert math.isnan(energy.groups["brakes"])
    assert energy.groups["electronics"] == 1.0
    assert math.isnan(energy.group_uncertainty["brakes"])
    assert energy.group_uncertainty["electronics"] == 1.0


def test_an_energy_from_before_groups_had_uncertainties_is_read() -> None:
    body = json.loads(encode_item(ENERGY, MARK))
    del body["group_uncertainty"]
    assert decode_item("energy", encode_json(body)) == replace(ENERGY, group_uncertainty={})


NUMBER = st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.builds(
        Energy,
        start=st.integers(0, 2**62),
        end=st.integers(0, 2**62),
        total=NUMBER,
        groups=st.dictionaries(st.text(max_size=20), NUMBER, max_size=8),
        uncertainty=NUMBER,
        positive_mechanical=NUMBER,
        motion_efficiency_percent=NUMBER,
        total_per_part=st.none() | NUMBER,
        group_uncertainty=st.dictionaries(st.text(max_size=20), NUMBER, max_size=8),
    )
)
def test_any_energy_survives_the_wire_to_the_bit(energy: Energy) -> None:
    back = decode_item("energy", encode_item(energy, MARK))
    assert back == energy
    assert repr(back) == repr(energy)  # minus zero is another number to the eye alone


def test_evidence_may_hold_what_stages_work_with() -> None:
    evidence = {"a_W": np.float64(1.5), "b": np.array([1.0, math.nan]), "c": np.int64(3), "d": Path("x"), "e": (1, 2)}
    payload = encode_item(Alarm("i", "k", "info", True, 1, 2, "s", evidence=evidence), MARK)
    assert json.loads(payload)["evidence"] == {"a_W": 1.5, "b": [1.0, None], "c": 3, "d": "x", "e": [1, 2]}


@pytest.mark.parametrize(
    ("kind", "payload"),
    [
        ("alarm", b""),
        ("alarm", b"[]"),
        ("alarm", b"{}"),
        ("alarm", b"null"),
        ("alarm", encode_json({**json.loads(encode_item(alarm(1), MARK)), "severity": "fatal"})),
        ("interval", b'{"pose": 3}'),
        ("prediction", b'{"outputs": []}'),
        ("energy", b"{}"),
        ("energy", b'{"groups": []}'),
        ("energy", b'{"group_uncertainty": 3}'),
        ("speed", b"{}"),
    ],
)
def test_messages_that_break_their_schema_are_refused(kind: str, payload: bytes) -> None:
    with pytest.raises(ProtocolError):
        decode_item(kind, payload)


def fits(value: Any, schema: dict[str, Any]) -> bool:
    """The part of JSON Schema that our schemas use."""
    if "anyOf" in schema:
        return any(fits(value, s) for s in schema["anyOf"])
    if "enum" in schema:
        return value in schema["enum"]
    names = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    types = {"integer": int, "number": int | float, "string": str, "boolean": bool, "null": type(None)}
    types |= {"array": list, "object": dict}
    if not any(isinstance(value, types[n]) for n in names):
        return False
    if isinstance(value, list):
        return all(fits(v, schema["items"]) for v in value)
    if not isinstance(value, dict):
        return True
    properties, others = schema.get("properties", {}), schema.get("additionalProperties", True)
    known = all(fits(value[n], s) for n, s in properties.items() if n in value)
    rest = isinstance(others, bool) or all(fits(v, others) for n, v in value.items() if n not in properties)
    return known and rest and all(n in value for n in schema.get("required", ()))


@pytest.mark.parametrize("item", ITEMS, ids=lambda i: type(i).__name__)
def test_messages_fit_their_schema(item: Any) -> None:
    kind = topic_of(item).split("/")[0]
    body = json.loads(encode_item(item, MARK))
    assert fits(body, schemas()[kind])
    assert set(body) == set(schemas()[kind]["properties"])
    assert not fits({k: v for k, v in body.items() if k != "mark"}, schemas()[kind])


def test_health_fits_its_schema() -> None:
    body = json.loads(health(MARK, EPOCH + 1, {"frame": (EPOCH, 5)}, {"state": "green", "load": math.nan}))
    assert fits(body, schemas()["health"])
    assert body["positions"] == {"frame": [EPOCH, 5]}


@pytest.mark.parametrize("kind", [*TYPES, "health"])
def test_schema_in_the_docs_is_the_one_of_the_code(kind: str) -> None:
    command = "python bench/schemas.py docs/schemas"
    assert json.loads((SCHEMAS / f"{kind}.json").read_text()) == schemas()[kind], f"run: {command}"


def test_schemas_are_written_one_a_kind(tmp_path: Path) -> None:
    write(tmp_path / "new")
    assert sorted(p.stem for p in (tmp_path / "new").iterdir()) == sorted([*TYPES, "health"])
