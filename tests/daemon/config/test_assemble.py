from __future__ import annotations

import pytest

from cellwatt.channel import Channel, Stream
from cellwatt.config import FrameSettings, load
from cellwatt.errors import ConfigError
from cellwatt.record.rows import MOST_VALUES
from cellwatt.runtime.assemble import layout_of, prepare
from tests.daemon.config.conftest import VALID


def test_stages_come_after_those_they_need(cell_file):
    cell_file.write_text(VALID.replace("  cut: {}\n", "").replace("tolerance: 10 %}", "tolerance: 10 %}\n  cut: {}"))
    names = list(prepare(load(cell_file)).stages)
    assert names.index("cut") < names.index("watch")


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        ("robot: testarm", "robot: ur10e", "12:3", "stages.power: the model is of the robot 'testarm', the cell has"),
        ("robot: testarm\n", "", "11:3", "the cell has None"),
        (
            "model.txt",
            "model.txt, input: bus.pover",
            "12:3",
            "no source has the channel 'bus.pover'; available: arm.",
        ),
        ("ttyUSB0", "ttyUSB0\n    unit: mW", "6:3", "sources.board: channel bus.power: unit 'mW' is not one of"),
        ("ttyUSB0", "ttyUSB0\n    twice: yes", "6:3", "sources.board: gives bus.power more than once"),
    ],
)
def test_what_does_not_fit_has_its_place(cell_file, old, new, place, message):
    cell_file.write_text(VALID.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        prepare(load(cell_file))
    (problem,) = caught.value.problems
    assert problem.place == f"{cell_file}:{place}"
    assert message in str(problem)


def test_a_cell_has_no_more_channels_than_its_frames_take():
    half, more = (Stream("tags", tuple(Channel(f"tag_{i}", "1") for i in range(n)), 10.0, "host") for n in (1016, 1017))
    assert len(layout_of({"plc": (half,), "line": (half,)}, FrameSettings()).channels) == MOST_VALUES
    with pytest.raises(ConfigError, match=r"sources: found 2,033 channels in all sources, expected at most 2,032"):
        layout_of({"plc": (half,), "line": (more,)}, FrameSettings())


def test_all_stages_that_do_not_fit_are_told(cell_file):
    cell_file.write_text(
        VALID.replace("testarm", "other").replace("  cut:", "  second: {stage: net, file: model.txt}\n  cut:")
    )
    with pytest.raises(ConfigError) as caught:
        prepare(load(cell_file))
    assert [p.path for p in caught.value.problems] == ["stages.second", "stages.power"]
