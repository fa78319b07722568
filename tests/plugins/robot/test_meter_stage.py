"""A slow meter in the frames of a cell: what it is, told as it runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellwatt import Alarm, ConfigError, FrameChannel, Frames, Layout
from cellwatt.channel import Quality
from cellwatt.frames import cut
from cellwatt.stage import CellInfo
from cellwatt_plugins.robot.meter.stage import MeterSettings, MeterStage
from tests.blocks import frames_of
from tests.plugins.robot.slow_meter import measured
from tests.plugins.robot.test_meter import Arm

RATE = 50.0
STEP = 20_000_000
EPOCH = 1_700_000_000_000_000_000
WINDOW, LATE = 0.2, 0.15
CELL = CellInfo("plant", "weld", None, Path())


def layout(declared: float = 0.0, method: str = "hold", arms: tuple[str, ...] = ("arm",)) -> Layout:
    joints = [
        FrameChannel(f"{arm}.joint_{j}.{what}", unit, "continuous", "linear")
        for arm in arms
        for what, unit in (("position", "rad"), ("torque", "Nm"))
        for j in (1, 2)
    ]
    return Layout((*joints, FrameChannel("mains.supply.power", "W", "continuous", method, declared)), RATE)  # type: ignore[arg-type]


def frames(of: Layout, arms: list[Arm], window: float = WINDOW) -> Frames:
    """What the aligner gives of these arms and a meter on the first one: its values held, as old as the bound says."""
    first = arms[0]
    time = np.arange(0, first.time[-1], 1 / RATE)
    joints = np.hstack([arm.joints(time) for arm in arms])
    ends = np.arange(0.37, first.time[-1], WINDOW)
    means = measured(first.time, first.power, np.maximum(ends - window, 0.0), ends)
    came = ends + LATE
    last = np.searchsorted(came, time, side="right") - 1
    there = last >= 0
    bound = np.zeros((len(time), joints.shape[1] + 1), np.int64)
    bound[:, -1] = np.round((time - came[np.maximum(last, 0)]) * 1e9) + 700_000
    quality = np.zeros(bound.shape, np.uint8)
    quality[~there, -1] = Quality.MISSING
    values = np.column_stack([joints, np.where(there, means[np.maximum(last, 0)], np.nan)])
    at = EPOCH + STEP * np.arange(len(time), dtype=np.int64)
    return Frames(of, 0, at, values, quality, bound)


def run(all_of: Frames, block: int = 25, **settings: object) -> list[Alarm]:
    stage = MeterStage("meter", MeterSettings.model_validate(settings), all_of.layout, CELL)
    told = []
    for first in range(0, len(all_of), block):
        told += stage.process(cut(all_of, first, first + block), ())
    told += stage.close()
    assert all(isinstance(each, Alarm) for each in told)
    return told


@pytest.mark.parametrize(
    ("declared", "severity", "words"),
    [(WINDOW, "info", "averaged over"), (0.05, "warning", "the declared window is 50 ms")],
)
def test_window_and_delay_are_told_while_the_arm_moves(declared, severity, words):
    (alarm,) = run(frames(layout(declared=declared), [Arm(60.0, 3)]), every="20 s")
    assert (alarm.kind, alarm.severity, alarm.source) == ("meter_timing", severity, "mains")
    assert words in alarm.statement
    assert alarm.time < EPOCH + 21e9
    assert alarm.evidence["window_s"] == pytest.approx(WINDOW, abs=0.01)
    assert alarm.evidence["late_s"] == pytest.approx(LATE, abs=0.01)
    assert alarm.evidence["interval_s"] == pytest.approx(WINDOW, abs=0.005)
    assert "mains.supply.power is averaged over" in alarm.statement


def test_of_two_arms_the_one_is_found_that_the_meter_supplies():
    (alarm,) = run(frames(layout(arms=("left", "right")), [Arm(60.0, 3), Arm(60.0, 4)]))
    assert alarm.evidence["arm"] == "left"
    assert alarm.evidence["late_s"] == pytest.approx(LATE, abs=0.01)


def test_values_that_repeat_before_a_gap_do_not_tell_the_interval():
    every = frames(layout(), [Arm(60.0, 3)])
    every.values[:115, -1] = np.where(np.arange(115) < 60, 60.0, 61.0)
    every.values[115:120, :-1] = np.nan
    (alarm,) = run(every)
    assert alarm.evidence["interval_s"] == pytest.approx(WINDOW, abs=0.005)


def test_an_arm_at_rest_tells_nothing():
    still = Arm(30.0, 3)
    still.qd[:], still.measured[:] = 0.0, 5.0
    still.power = 60 + np.random.default_rng(0).normal(0, 0.3, len(still.time))
    assert run(frames(layout(), [still])) == []


def test_a_block_of_frames_may_be_longer_than_what_is_kept():
    of = Layout(layout().channels, 1.0)
    count, columns = 200, len(of.channels)
    at = EPOCH + 10**9 * np.arange(count, dtype=np.int64)
    stage = MeterStage("meter", MeterSettings(), of, CELL)
    block = frames_of(of, 0, at, np.full((count, columns), np.nan), Quality.MISSING)
    assert [*stage.process(block, ()), *stage.close()] == []


def test_a_cell_without_a_slow_meter_or_an_arm_is_told():
    for power, of, message in (
        (None, layout(method="average"), "slower than the frames"),
        ("supply.power", layout(method="average"), "no window to find"),
        (None, layout(arms=()), r"joint_1\.position"),
    ):
        with pytest.raises(ConfigError, match=message):
            MeterStage("meter", MeterSettings(power=power), of, CELL)
