"""A meter that logged into a file of its own: its clock against the robot's, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellwatt.arrays import rows_of
from cellwatt.errors import RecordingError
from cellwatt_plugins.robot.meter.file import power_beside
from cellwatt_plugins.robot.meter.find import find
from cellwatt_plugins.robot.meter.held import held
from tests.plugins.robot.slow_meter import measured
from tests.plugins.robot.test_meter import Arm

ARM = Arm(90.0)
POSITION = ARM.position


def logged(folder: Path, offset: float, interval: float, arm: Arm = ARM, late: float = 0.1) -> Path:
    """What a meter of one mean an interval wrote, its clock ``offset`` s ahead of the robot's."""
    ends = np.arange(0.0031 + interval, arm.time[-1], interval)
    means = measured(arm.time, arm.power, ends - interval, ends)
    path = folder / "meter.csv"
    rows = np.column_stack([ends + late + offset, means])
    np.savetxt(path, rows, delimiter=",", header="t,power", comments="", fmt="%.6f")
    return path


@pytest.mark.parametrize(
    "offset", [pytest.param(-4.2, marks=pytest.mark.slow), 0.0, 0.73, pytest.param(3.9, marks=pytest.mark.slow)]
)
def test_the_motion_tells_how_far_the_clocks_are_apart(tmp_path, offset):
    power = power_beside(logged(tmp_path, offset, 0.1), ARM.time, POSITION)
    readings = held([(ARM.time, power)], 0.1)
    assert readings is not None
    meter = find(readings, [ARM.course])
    assert meter is not None
    windows = meter.windows(readings[0])
    inside = windows.inside(ARM.time)
    true = rows_of(windows, inside).means(ARM.time, ARM.power)
    # Values a tenth of a second off would miss the power by far more than its noise.
    assert np.std(readings[0].value[inside] - true) < 0.1 * np.std(true)
    assert meter.window == pytest.approx(0.1, abs=0.01)


def test_files_that_do_not_belong_together_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="does not follow the motion"):
        power_beside(logged(tmp_path, 0.0, 0.1, Arm(90.0, seed=5)), ARM.time, POSITION)
    with pytest.raises(RecordingError, match=r"give files of the same time.*from 500\.\d to 590\.\d s.*from 0\.0 to"):
        power_beside(logged(tmp_path, 500.0, 0.1), ARM.time, POSITION)


@pytest.mark.parametrize(
    ("meter", "recording"), [pytest.param(1.7e9 + 7200, 1.7e9, id="time zone"), pytest.param(1.7e9, 0.0, id="uptime")]
)
def test_clocks_that_cannot_be_the_same_are_brought_together(tmp_path, meter, recording):
    here = power_beside(logged(tmp_path, 0.0, 0.1), ARM.time, POSITION)
    there = power_beside(logged(tmp_path, meter, 0.1), recording + ARM.time, POSITION)
    assert np.mean(there != here) < 0.1, "values come at most some ms apart"


@pytest.mark.parametrize(
    ("name", "slope", "message"),
    [
        ("power", 0.01, "is it the count of an energy meter"),
        ("power", 0.0, "does not follow the motion"),
        ("volts", 0.0, r"no column power; there are: volts"),
    ],
)
def test_what_is_no_power_is_refused(tmp_path, name, slope, message):
    path = tmp_path / "meter.csv"
    rows = [[0.1 * i, 5000 + slope * i] for i in range(900)]
    np.savetxt(path, rows, delimiter=",", header=f"t,{name}", comments="")
    with pytest.raises(RecordingError, match=message):
        power_beside(path, ARM.time, POSITION)


def test_rows_without_a_position_tell_nothing_of_the_clocks(tmp_path):
    holed = POSITION.copy()
    holed[1000:1010, 1] = np.nan
    log = logged(tmp_path, 0.73, 0.1)
    wrong = power_beside(log, ARM.time, holed) != power_beside(log, ARM.time, POSITION)
    assert np.mean(wrong) < 0.1, "values come at most some ms earlier or later"
    with pytest.raises(RecordingError, match="does not follow the motion"):
        power_beside(log, ARM.time, np.full_like(POSITION, np.nan))
