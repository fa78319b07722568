"""Lines that say what they were made of, whatever names and texts are in it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from cellwatt.outlets.historian.client import line, result_line, row_line
from cellwatt.outlets.selection import Row
from tests.daemon.outlets.historian.made import alarm, energy, task
from tests.daemon.outlets.historian.parsing import parse

TIME = 1_800_000_000_123_456_789
TAGS = {"site": "plant 1", "cell": "weld,3"}

texts = st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=30)
names = texts.filter(lambda text: not set(text) & set("\\\n\r"))
values = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False), st.integers(-(2**63), 2**63 - 1), st.booleans(), texts
)


@given(names, st.dictionaries(names, names, max_size=4), st.dictionaries(names, values, min_size=1, max_size=4))
def test_a_line_says_what_it_was_made_of(measurement, tags, fields) -> None:
    point = parse(line(measurement, tags, fields, TIME))
    assert (point.measurement, point.tags, point.time) == (measurement, tags, TIME)
    assert point.fields == fields


@given(texts, texts)
def test_no_name_breaks_its_line(key, value) -> None:
    """Also with backslashes and line breaks, which names cannot hold."""
    text = line("m", {f"k{key}": f"v{value}"}, {f"f{key}": 1.0}, TIME)
    assert "\n" not in text
    point = parse(text)
    blank = {ord("\\"): "/", ord("\n"): " ", ord("\r"): " "}
    assert point.tags == {f"k{key}".translate(blank): f"v{value}".translate(blank)}
    assert point.fields == {f"f{key}".translate(blank): 1.0}


def test_what_has_no_value_is_left_out() -> None:
    nan, inf = float("nan"), float("inf")
    assert line("m", {"a": "", "b": None}, {"x": nan, "y": inf, "z": None, "w": 0.5}, 7) == "m w=0.5 7"
    assert line("m", {}, {"x": nan}, 7) == ""
    assert row_line("m", {}, Row(0, 7, {}, {"a": 4})) == ""


def test_a_row_is_one_point() -> None:
    row = Row(49, TIME, {"arm.bus.power": 230.25, "arm.mode": 7.0}, {"arm.bus.power": 1, "arm.mode": 0, "off": 4})
    point = parse(row_line("cellwatt", TAGS, row))
    assert (point.measurement, point.tags, point.time) == ("cellwatt", TAGS, TIME)
    assert point.fields == {"arm.bus.power": 230.25, "arm.mode": 7.0, "quality": 1}


def test_results_are_points_of_their_own() -> None:
    said = parse(result_line("cellwatt", TAGS, alarm(3, TIME)))
    assert said.measurement == "cellwatt_alarm"
    assert said.tags == {**TAGS, "id": "a3", "kind": "joint_fault", "severity": "error", "source": "arm"}
    assert (said.fields["active"], said.fields["joint"], said.fields["statement"]) == (True, 3, "Joint 3.")
    assert said.fields["evidence"] == '{"residual_W":null,"n":3}'
    done = parse(result_line("cellwatt", TAGS, task(4, TIME)))
    assert (done.tags["task"], done.tags["variant"], done.fields["seconds"]) == ("task_1", "speed=1.00", 7.0)
    used = parse(result_line("cellwatt", TAGS, energy(5, TIME)))
    assert (used.fields["total"], used.fields["group.mechanical_losses"], used.fields["repetition"]) == (105.0, 65.0, 5)
