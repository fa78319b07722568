"""The pages of alarms, mismatch and reports, filled with what the stage and the explanation really give."""

from __future__ import annotations

import json

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from cellwatt.results import Alarm, Prediction
from cellwatt.stage import CellInfo
from cellwatt_plugins.mismatch.explain import explain
from cellwatt_plugins.mismatch.input.baseline import baseline
from cellwatt_plugins.mismatch.live.settings import MismatchSettings
from cellwatt_plugins.mismatch.stage import MismatchStage
from cellwatt_plugins.segment import SegmentSettings, SegmentStage
from tests.daemon.outlets.page.told import page_told
from tests.plugins.mismatch import plant
from tests.plugins.mismatch.emulated_arm import cut, frames, layout, recorded
from tests.plugins.mismatch.plant import REAL, Missing, loaded
from tests.plugins.mismatch.recorded_arm import write_robot

PAYLOAD = 2.0  # kg that the simulation does not know of


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """What the stage gives of an arm on whose joint 2 friction comes at 8 s."""
    robot = write_robot(tmp_path_factory.mktemp("robot"), viscous_friction=0.0).parent
    whole = frames(recorded(24, 50, viscous=30.0, since=8.0), layout())
    cell = CellInfo("plant", "cell", None, robot)
    segment = SegmentStage("segment", SegmentSettings(), whole.layout, cell)
    stage = MismatchStage("mismatch", MismatchSettings(robot=robot, explain=None), whole.layout, cell)
    out = []
    for first in range(0, len(whole), 50):
        block = cut(whole, first, first + 50)
        intervals = list(segment.process(block, ()))
        out += [*intervals, *stage.process(block, intervals)]
    return [*out, *stage.close()]


async def test_the_page_shows_the_joint_that_differs_with_its_evidence(results, tmp_path):
    assert any(isinstance(result, Prediction) for result in results)
    (raised,) = [r for r in results if isinstance(r, Alarm) and r.joint is not None]
    async with page_told(tmp_path, results) as ask:
        alarms = [alarm for alarm in (await ask("state"))["alarms"] if alarm["joint"] is not None]
    (alarm,) = alarms
    assert (alarm["kind"], alarm["joint"], alarm["statement"]) == ("simulation_differs", 2, raised.statement)
    evidence = alarm["evidence"]
    assert evidence["residual_Nm"] > evidence["limit_Nm"] > evidence["noise_floor_Nm"]


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """A folder in which an explanation was written as ``cellwatt explain`` does."""
    arm = plant.load(plant.write_robot(tmp_path_factory.mktemp("plant")))
    missing = Missing(arm=loaded(REAL, PAYLOAD, 0.12))
    runs = [plant.record("run_01", 1, missing), plant.record("run_02", 2, missing)]
    with threadpool_limits(1):
        found = explain(runs, baseline(runs, arm))
    folder = tmp_path_factory.mktemp("reports") / "one"
    folder.mkdir()
    (folder / "findings.json").write_text(json.dumps(found.as_json()))
    found.report(folder / "report.html")
    return folder.parent


async def test_the_pages_of_mismatch_and_reports_tell_what_was_missing(reports, tmp_path):
    async with page_told(tmp_path, [], reports) as ask:
        told, listed = await ask("mismatch"), await ask("reports")
    (effect,) = told["effects"]
    assert (effect["effect"], effect["joint"]) == ("payload", None)
    assert effect["confidence"] > 0.9
    assert str(PAYLOAD) in effect["statement"] or "2.0" in effect["statement"]
    assert np.isfinite([told["before"], told["after"]]).all()
    assert told["after"] < 0.2 * told["before"]
    assert told["unit"]
    (report,) = listed["reports"]
    assert report["finding"] == told["finding"]
    assert listed["broken"] == []
    assert told["href"] == report["href"]
