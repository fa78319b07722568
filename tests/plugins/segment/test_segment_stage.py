import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from cellwatt.emulation import ArmSignals
from cellwatt.errors import ConfigError
from cellwatt.results import Interval, Task
from cellwatt.stage import CellInfo
from cellwatt_plugins.segment import SegmentSettings, SegmentStage
from tests.blocks import frames_of, layout_of
from tests.plugins.segment.motions import START, since_start

RATE = 50.0


def stage(unit="rad"):
    layout = layout_of({f"arm.joint_{j}.position": unit for j in range(1, 7)}, RATE)
    return SegmentStage("segment", SegmentSettings(), layout, CellInfo("plant", "cell", None, Path()))


def segmented(signals, seconds, block=5):
    """Results of the stage for an emulated arm, whose frames come in blocks."""
    t = np.arange(round(seconds * RATE)) / RATE
    values = np.column_stack([signals.at(t)[f"joint_{j}.position"] for j in range(1, 7)])
    time = START + np.round(t * 1e9).astype(np.int64)
    made, results = stage(), []
    for i in range(0, len(t), block):
        rows = slice(i, i + block)
        results += made.process(frames_of(made.layout, i, time[rows], values[rows]), ())
    return results + list(made.close())


def test_the_emulated_arm_is_cut_into_its_moves():
    signals = ArmSignals(seed=5)
    results = segmented(signals, 60.0)
    found = [r for r in results if isinstance(r, Interval) and r.closed and r.moving and r.complete]
    assert [i.moving for i in found[:8]] == [(3,), (2, 5), (6,), (3,), (1,), (2, 5), (6,), (1,)]
    tasks = [r for r in results if isinstance(r, Task)]
    assert [t.repetition for t in tasks] == list(range(1, len(tasks) + 1))
    assert len(tasks) >= 6
    assert {round(since_start(t.start) % signals.period, 1) for t in tasks} <= {0.0, 7.8}
    assert results[-1].closed


def test_blocks_of_any_size_give_the_same_results():
    assert segmented(ArmSignals(seed=2), 30.0, block=7) == segmented(ArmSignals(seed=2), 30.0)


def test_positions_must_be_in_rad_or_m():
    stage("m")
    with pytest.raises(ConfigError, match=r"arm\.joint_1\.position is in 1, expected rad, or m of a slide"):
        stage("1")


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [("start_speed", "2 m/s", "unknown unit 'm/s'"), ("stop_speed", "3 deg/s", "must not be above start_speed")],
)
def test_wrong_settings_are_refused(key, value, text):
    with pytest.raises(ValidationError, match=text):
        SegmentSettings.model_validate({key: value})


def test_a_plain_installation_can_cut_motion():
    """Neither Pinocchio nor SciPy, which are extras, is needed for README's cell."""
    script = "import sys, cellwatt_plugins.segment; sys.exit('pinocchio' in sys.modules or 'scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
