"""Predicted beside measured power in the live view."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from click.testing import CliRunner

from cellwatt import FrameChannel, Frames, Layout, Prediction
from cellwatt.commands import watch
from cellwatt.commands.live_power import BARS, SPAN, LivePower
from cellwatt.commands.live_view import LiveCell
from cellwatt.commands.watch import kind_and_body
from cellwatt.subscriber import Health, Message
from tests.daemon.commands.test_live_view import STATUS, shown

CHANNELS = (("arm.joint_1.position", "rad"), ("board.supply.power", "W"), ("mains.supply.power", "W"))
LAYOUT = Layout(tuple(FrameChannel(name, unit, "continuous", "linear") for name, unit in CHANNELS), 10.0)
SECOND = 10**9


def message(first, power):
    """Frames every 0.1 s from the ``first`` one on; the mains draw 300 W more than the board."""
    values = np.column_stack([np.zeros(len(power)), power, np.add(power, 300.0)])
    time = LAYOUT.step * np.arange(first, first + len(power))
    zeros = np.zeros(values.shape, np.int64)
    return Message("frame", 1, first, False, Frames(LAYOUT, first, time, values, zeros.astype(np.uint8), zeros))


def frames(first, power):
    return kind_and_body(message(first, power))


def prediction(first, power):
    times = tuple((LAYOUT.step * np.arange(first, first + len(power))).tolist())
    outputs = {"power": tuple(power), "current_1": tuple(0.0 for _ in power)}
    said = Prediction("model", first, times, outputs, {"power": "W", "current_1": "A"})
    return kind_and_body(Message("prediction/model", 1, first, False, said))


def lines(view):
    return [line.plain for line in view.power.lines()]


def test_predicted_and_measured_power_are_below_each_other_and_how_far_apart():
    view = LiveCell(status=STATUS, power=LivePower("board.supply.power"))
    assert lines(view) == []
    view.add(*frames(0, [100.0, 140.0, 180.0, 100.0]))
    assert lines(view) == []  # no model: nothing to compare
    view.add(*prediction(0, [103.0, 137.0, 183.0, 97.0]))
    predicted, measured = lines(view)
    assert predicted.startswith("predicted (model) ")
    assert predicted.endswith(" 97.0 W")
    assert measured.startswith("board.supply.power ")
    assert "100.0 W  off 3.0 W rms" in measured
    assert BARS[0] in predicted  # the lowest of both is 97 W, the highest 183 W
    assert BARS[-1] in predicted
    assert predicted in shown(view)
    assert measured in shown(view)


def test_only_values_of_the_same_frame_are_compared_whichever_comes_first():
    """A model that speaks of frames a second late must not seem wrong for it."""
    power = [100.0 + 50.0 * (i % 2) for i in range(40)]
    early, late = (LiveCell(power=LivePower("board.supply.power")) for _ in range(2))
    early.add(*frames(0, power))
    early.add(*prediction(0, power[:30]))
    late.add(*prediction(0, power[:30]))
    late.add(*frames(0, power))
    for view in (early, late):
        assert "off 0.0 W" in lines(view)[1]
        assert lines(view)[1].rstrip().split(" W")[0].endswith("150.0")


def test_missing_values_are_left_out():
    view = LiveCell(power=LivePower("board.supply.power"))
    nan = float("nan")
    view.add(*frames(0, [100.0, nan, 100.0]))
    view.add(*prediction(0, [nan, 90.0, 96.0]))
    assert "off 4.0 W" in lines(view)[1]
    blind = LiveCell()
    blind.add(*prediction(0, [nan]))
    assert lines(blind) == []


def test_without_a_name_every_supply_is_shown_and_named():
    view = LiveCell()
    view.add(*prediction(0, [100.0, 101.0]))
    view.add(*frames(0, [100.0, 101.0]))
    assert [line.split()[0] for line in lines(view)[1:]] == ["board.supply.power", "mains.supply.power"]
    assert "off 0.0 W" in lines(view)[1]
    assert "off 300.0 W" in lines(view)[2]


def test_it_shows_the_last_seconds_only():
    view = LiveCell(power=LivePower("board.supply.power"))
    rows = round(SPAN * LAYOUT.rate) + 50
    view.add(*frames(0, [500.0, *[100.0] * (rows - 1)]))
    view.add(*prediction(0, [0.0, *[100.0] * (rows - 1)]))
    assert "off 0.0 W" in lines(view)[1]
    assert all(len(course) <= SPAN * LAYOUT.rate + 1 for course in view.power.measured.values())


def test_a_line_of_json_tells_power_with_its_times_and_nothing_where_there_is_none():
    kind, told = frames(5, [100.0, float("nan")])
    assert kind == "frame"
    assert told["time"] == [SECOND // 2, 6 * SECOND // 10]
    assert told["power"] == {"board.supply.power": [100.0, None], "mains.supply.power": [400.0, None]}
    layout = Layout(LAYOUT.channels[:1], 10.0)
    zeros = np.zeros((1, 1), np.int64)
    block = Frames(layout, 0, np.array([0]), np.zeros((1, 1)), zeros.astype(np.uint8), zeros)
    _, without = kind_and_body(Message("frame", 1, 0, False, block))
    assert set(without) == {"count", "start", "end"}


@pytest.mark.parametrize("output", ["power", "brakes"])
def test_a_power_of_another_name_is_told_by_it(output):
    said = replace(Prediction("net", 0, (0,), {}, {}), outputs={output: (5.0,)}, units={output: "W"})
    view = LiveCell()
    view.add("prediction", asdict(said))
    assert lines(view)[0].startswith("predicted (net)" if output == "power" else "brakes (net)")


@pytest.mark.parametrize("words", [(), ("--power", "mains.supply.power")])
def test_watch_takes_frames_for_its_view_and_shows_both(monkeypatch, words):
    wanted = []

    class Cell:
        """Stands for the bus: three messages, then the cell is gone."""

        def __init__(self, *_, want, verify):
            wanted.append(want)
            assert verify is None

        async def __aenter__(self):
            return self

        async def __aexit__(self, *_):
            pass

        async def __aiter__(self):
            yield Message("health", 1, 0, False, Health(1, 0, {}, STATUS))
            yield message(0, [100.0, 140.0])
            said = Prediction("model", 0, (0, LAYOUT.step), {"power": (103.0, 137.0)}, {"power": "W"})
            yield Message("prediction/model", 1, 0, False, said)

    monkeypatch.setattr(watch, "Subscriber", Cell)
    given = ("--connect", "tcp/127.0.0.1:7447", "--site", "plant-1", "--cell", "weld-3")
    done = CliRunner().invoke(watch.command, [*given, *words], catch_exceptions=False)
    assert "frame" in wanted[0]
    assert "predicted (model)" in done.output
    assert ("board.supply.power" in done.output) == (not words)
    assert ("off 3.0 W" in done.output) == (not words)
    assert "mains.supply.power" in done.output
