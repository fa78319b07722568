import subprocess
import sys

import numpy as np
import pytest
from pydantic import ValidationError

from cellwatt.emulation import ArmSignals
from cellwatt.errors import ConfigError
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.results import Interval, Task
from cellwatt.stage import CellInfo
from cellwatt_plugins.segment import SegmentSettings, SegmentStage

RATE = 50.0


def layout(*sources, unit="rad"):
    channels = [
        FrameChannel(f"{s}.joint_{j}.position", unit, "continuous", "linear") for s in sources for j in range(1, 7)
    ]
    return Layout(tuple(channels), RATE)


def cell(folder):
    return CellInfo("plant", "cell", None, folder)


def blocks(lay, signals, seconds, block=5):
    t = np.arange(round(seconds * RATE)) / RATE
    values = np.column_stack([signals.at(t)[f"joint_{j}.position"] for j in range(1, 7)])
    time = 1_700_000_000_000_000_000 + np.round(t * 1e9).astype(np.int64)
    for i in range(0, len(t), block):
        part = values[i : i + block]
        yield Frames(lay, i, time[i : i + block], part, np.zeros(part.shape, np.uint8), np.zeros(part.shape, np.int64))


def test_the_emulated_arm_is_cut_into_its_moves(tmp_path):
    lay = layout("arm")
    stage = SegmentStage("segment", SegmentSettings(), lay, cell(tmp_path))
    signals = ArmSignals(seed=5)
    results = [r for frames in blocks(lay, signals, 60.0) for r in stage.process(frames, ())] + list(stage.close())
    found = [r for r in results if isinstance(r, Interval) and r.closed and r.moving and r.complete]
    assert [i.moving for i in found[:8]] == [(3,), (2, 5), (6,), (3,), (1,), (2, 5), (6,), (1,)]
    tasks = [r for r in results if isinstance(r, Task)]
    assert [t.repetition for t in tasks] == list(range(1, len(tasks) + 1))
    assert len(tasks) >= 6
    assert {round((t.start - 1_700_000_000_000_000_000) * 1e-9 % signals.period, 1) for t in tasks} <= {0.0, 7.8}
    assert results[-1].closed


def test_blocks_of_any_size_give_the_same_results(tmp_path):
    def results(size):
        lay = layout("arm")
        stage = SegmentStage("segment", SegmentSettings(), lay, cell(tmp_path))
        out = [r for frames in blocks(lay, ArmSignals(seed=2), 30.0, size) for r in stage.process(frames, ())]
        return out + list(stage.close())

    assert results(7) == results(5)


def test_positions_must_be_in_rad_or_m(tmp_path):
    SegmentStage("segment", SegmentSettings(), layout("arm", unit="m"), cell(tmp_path))
    with pytest.raises(ConfigError, match=r"arm\.joint_1\.position is in 1, expected rad, or m of a slide"):
        SegmentStage("segment", SegmentSettings(), layout("arm", unit="1"), cell(tmp_path))


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("start_speed", "2 m/s", "unknown unit 'm/s'"),
        ("stop_speed", "3 deg/s", "must not be above start_speed"),
    ],
)
def test_wrong_settings_are_refused(key, value, text):
    with pytest.raises(ValidationError, match=text):
        SegmentSettings.model_validate({key: value})


def test_a_plain_installation_can_cut_motion():
    """Neither Pinocchio nor SciPy, which are extras, is needed for README's cell."""
    script = "import sys, cellwatt_plugins.segment; sys.exit('pinocchio' in sys.modules or 'scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
