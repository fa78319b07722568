"""Predicted beside measured power."""

import json

import numpy as np
import pytest

from cellwatt import Frames, Layout
from cellwatt.live.as_json import line_of, take_line
from cellwatt.live.power import power
from cellwatt.live.sparkline import BARS
from cellwatt.live.state import LiveCell
from cellwatt.subscriber import Message
from tests.daemon.live.cells import LAYOUT, START, frames, prediction

BOARD = "board.supply.power"


def lines(*messages, channel=BOARD, span=10.0):
    cell = LiveCell()
    for message in messages:
        cell.take(message)
    return [line.plain for line in power(cell, span, 80, channel)]


def test_predicted_and_measured_power_are_below_each_other_and_how_far_apart() -> None:
    measured = frames(0, [100.0, 140.0, 180.0, 100.0])
    assert lines() == lines(measured) == []  # no model: nothing to compare
    said, found = lines(measured, prediction(0, [103.0, 137.0, 183.0, 97.0]))
    assert said.startswith("predicted (model) ")
    assert said.endswith(" 97.0 W")
    assert found.startswith("board.supply.power ")
    assert "100.0 W  off 3.0 W rms" in found
    assert BARS[0] in said  # the lowest of both is 97 W, the highest 183 W
    assert BARS[-1] in said
    assert BARS[0] in found  # 100 W


def test_only_values_of_the_same_frame_are_compared_whichever_comes_first() -> None:
    """A model that speaks of frames a second late must not seem wrong for it."""
    course = [100.0 + 50.0 * (i % 2) for i in range(40)]
    for messages in ((frames(0, course), prediction(0, course[:30])), (prediction(0, course[:30]), frames(0, course))):
        found = lines(*messages)[1]
        assert "off 0.0 W" in found
        assert found.split(" W")[0].endswith("150.0")


def test_missing_values_are_left_out() -> None:
    nan = float("nan")
    assert "off 4.0 W" in lines(frames(0, [100.0, nan, 100.0]), prediction(0, [nan, 90.0, 96.0]))[1]
    assert lines(prediction(0, [nan])) == []


def test_without_a_name_every_supply_is_shown_and_named() -> None:
    shown = lines(prediction(0, [100.0, 101.0]), frames(0, [100.0, 101.0]), channel=None)[1:]
    assert [line.split()[0] for line in shown] == [BOARD, "mains.supply.power"]
    assert ["off 0.0 W" in shown[0], "off 300.0 W" in shown[1]] == [True, True]


def test_it_shows_the_last_seconds_only() -> None:
    rows = round(10.0 * LAYOUT.rate) + 50
    measured, said = frames(0, [500.0, *[100.0] * (rows - 1)]), prediction(0, [0.0, *[100.0] * (rows - 1)])
    assert "off 0.0 W" in lines(measured, said)[1]
    assert "off 0.0 W" not in lines(measured, said, span=60.0)[1]


@pytest.mark.parametrize("output", ["power", "brakes"])
def test_a_power_of_another_name_is_told_by_it(output: str) -> None:
    (line,) = lines(prediction(0, [5.0], output, "net"))
    assert line.startswith("predicted (net)" if output == "power" else "brakes (net)")


def test_a_line_of_json_tells_power_with_its_times_and_nothing_where_there_is_none() -> None:
    line = line_of(frames(5, [100.0, float("nan")]))
    told = line["content"]
    assert line["kind"] == "frame"
    assert told["time"] == [START + 5 * LAYOUT.step, START + 6 * LAYOUT.step]
    assert told["power"] == {BOARD: [100.0, None], "mains.supply.power": [400.0, None]}
    layout = Layout(LAYOUT.channels[:1], 10.0)
    zeros = np.zeros((1, 1), np.int64)
    block = Frames(layout, 0, np.array([0]), np.zeros((1, 1)), zeros.astype(np.uint8), zeros)
    assert set(line_of(Message("frame", 1, 0, False, block))["content"]) == {"count", "start", "end"}


def test_lines_of_json_show_the_same_as_the_messages() -> None:
    """``demo`` shows what another process, its subscriber, printed."""
    messages = frames(0, [100.0, float("nan"), 180.0]), prediction(0, [103.0, 137.0, float("nan")])
    cell = LiveCell()
    for message in messages:
        take_line(cell, json.loads(json.dumps(line_of(message))))
    assert [line.plain for line in power(cell, 10.0, 80)] == lines(*messages, channel=None)
    take_line(cell, {"kind": "frame", "content": {"count": 1, "start": 0, "end": 0}})  # without power
