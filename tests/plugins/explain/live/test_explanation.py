"""The explanation that the stage starts: on what, how often, what is said of it, and what when it fails."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import datetime, timedelta
from itertools import chain, islice, pairwise
from pathlib import Path
from urllib.parse import urlparse
from urllib.request import url2pathname

import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest

from cellwatt.stage import CellInfo
from cellwatt_plugins.explain.live import explanation
from cellwatt_plugins.explain.live.alarms import Occasion, found
from cellwatt_plugins.explain.live.explanation import Outcome
from cellwatt_plugins.explain.live.settings import ExplainSettings, MismatchSettings
from cellwatt_plugins.explain.stage import MismatchStage
from tests.plugins.explain.emulated_arm import START, frames, recorded
from tests.plugins.explain.test_stage import fed

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(autouse=True)
def _gets_its_turn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stage explains at the lowest priority: beside busy processes it would not come to its end."""
    if request.node.originalname != "test_it_gives_way_and_ends_by_itself":
        monkeypatch.setattr(explanation, "NICENESS", 0)


@pytest.fixture(scope="module")
def stiff():
    """Friction comes on joint 2 at 14 s and goes at 40 s."""
    return frames(recorded(70, viscous=30.0, since=14.0, until=40.0))


class Watched:
    """The stage with the segmenter before it, fed second by second."""

    def __init__(self, robot: Path, folder: Path, whole, **explain):
        settings = MismatchSettings(robot=robot, explain=ExplainSettings(**({"after": 4, "folder": folder} | explain)))
        cell = CellInfo("plant", "weld-3", None, robot)
        self.stage = MismatchStage("mismatch", settings, whole.layout, cell)
        self._seconds = fed(self.stage, whole)
        self._at = 0

    def until(self, seconds: int) -> list:
        """Alarms about the explanation up to a time, s."""
        count, self._at = seconds - self._at, seconds
        results = chain.from_iterable(islice(self._seconds, count))
        return [r for r in results if getattr(r, "kind", "") in ("mismatch", "explanation_failed")]


@pytest.fixture
def watch(robot, tmp_path, stiff):
    """Makes watched stages that are ended with the test."""
    stages = []

    def make(folder: Path = tmp_path, whole=stiff, **explain) -> Watched:
        stages.append(Watched(robot, folder, whole, **explain))
        return stages[-1]

    yield make
    for watched in stages:
        watched.stage.close()


def children_done() -> None:
    """Wait until all have ended, and leave it to their parent to ask how."""
    for child in psutil.Process().children():
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)


def explanations(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir()) if folder.exists() else []


@pytest.mark.slow
def test_friction_is_named_and_gone_again(watch, tmp_path, stiff):
    watched = watch()
    assert watched.until(33) == []
    children_done()
    alarms = watched.until(34)
    assert [a.kind for a in alarms] == ["mismatch"]
    alarm = alarms[0]
    assert (alarm.severity, alarm.active, alarm.joint) == ("warning", True, 2)
    assert "viscous friction" in alarm.statement
    first = alarm.evidence["findings"][0]
    assert (first["effect"], first["joint"]) == ("viscous_friction", 2)
    (value,) = [p["value"] for p in first["parameters"].values()]
    assert value == pytest.approx(30.0, rel=0.1)
    report = Path(url2pathname(urlparse(alarm.evidence["report"]).path))
    assert report.parent.parent == tmp_path
    assert b"<html" in report.read_bytes()
    assert {p.name for p in report.parent.iterdir()} >= {"recording.parquet", "robot.yaml", "model.yaml"}
    table = pq.read_table(report.parent / "recording.parquet")
    time = np.asarray(table["t"])
    assert time[0] == 0.0
    assert time[-1] == pytest.approx(alarm.evidence["recording_s"]) == pytest.approx(8, abs=3), "since the onset"
    since = round((alarm.since - START) * 1e-9 * 50)
    np.testing.assert_array_equal(np.asarray(table["tau_2"])[:200], stiff.values[since : since + 200, 13])
    later = watched.until(70)
    assert [(a.kind, a.active) for a in later] == [("mismatch", False)], "not explained twice in an hour, and cleared"
    assert len(explanations(tmp_path)) == 1


def test_what_explain_refuses_is_said_with_its_reason(watch, stiff):
    values = stiff.values.copy()
    values[:, 12:18] *= 1000  # mNm
    watched = watch(whole=replace(stiff, values=values))
    alarms = watched.until(30)  # it may have been refused by then
    if not alarms:
        children_done()
        alarms = watched.until(31)
    (alarm,) = alarms
    assert (alarm.kind, alarm.severity, alarm.active) == ("explanation_failed", "warning", True)
    assert "in mNm" in alarm.statement
    assert alarm.evidence["failures"] == 1


@pytest.mark.parametrize(
    ("takes", "reason"), [({"limit": 0.01}, "took longer than"), ({"memory": 1e6}, "needed more than 1 MB")]
)
def test_it_may_not_take_more_than_allowed(watch, takes, reason):
    watched = watch(**takes)
    alarms = watched.until(30)
    if not alarms:
        children_done()
        alarms = watched.until(31)
    assert [a.kind for a in alarms] == ["explanation_failed"]
    assert reason in alarms[0].statement
    assert not psutil.Process().children()


def test_it_ends_by_itself_where_no_frames_come_to_stop_it(watch):
    watched = watch(limit=0.01)
    assert watched.until(22) == []
    assert psutil.Process().children()
    children_done()
    (alarm,) = watched.until(31)
    assert "took longer than" in alarm.statement


def test_it_is_not_tried_more_often_than_allowed(watch, tmp_path):
    watched = watch(limit=0.01, every=5.0)
    alarms = watched.until(39)
    assert [a.evidence["failures"] for a in alarms] == list(range(1, len(alarms) + 1))
    assert len(alarms) >= 3
    begun = [datetime.strptime(name, "weld-3-mismatch-%Y%m%dT%H%M%SZ") for name in explanations(tmp_path)]
    assert min(b - a for a, b in pairwise(begun)) >= timedelta(seconds=5)


def test_it_gives_way_and_ends_by_itself(watch):
    watched = watch(limit=45.0)
    watched.until(33)
    (child,) = psutil.Process().children()
    assert child.nice() == 19
    assert child.rlimit(psutil.RLIMIT_CPU) == (46, 47)


def test_the_newest_stay_and_the_new_one_whatever_the_clock_says(tmp_path):
    for day in (4, 5, 1, 1):  # the last is the replay of the one before
        explanation.new_folder(tmp_path, f"weld-3-2026010{day}T000000Z", keep=2)
    assert explanations(tmp_path) == ["weld-3-20260101T000000Z", "weld-3-20260105T000000Z"]


def said(verdict, findings=(), unexplained=()):
    return {"verdict": verdict, "findings": list(findings), "unexplained": list(unexplained)}


def finding(effect, joint, kind="missing"):
    return {
        "effect": effect,
        "joint": joint,
        "kind": kind,
        "confidence": 0.9,
        "statement": f"{effect} at {joint}.",
        "parameters": {},
        "alternatives": [{"effect": "unknown", "joint": joint, "why": "who knows"}],
    }


@pytest.mark.parametrize(
    ("findings", "severity", "joint", "statement"),
    [
        (
            said("partly_explained", [finding("viscous_friction", 2, "mistuned"), finding("backlash", 2)]),
            "warning",
            2,
            "backlash at 2. viscous_friction at 2.",
        ),
        (said("explained", [finding("spring_load", 4)]), "warning", None, "Only effects that the model already has"),
    ],
)
def test_an_outcome_in_words(tmp_path, findings, severity, joint, statement):
    told = Occasion("mismatch", "arm", 5, 9, 60.0)
    alarm = found(told, Outcome(tmp_path, findings), {("spring_load", 4)})
    assert (alarm.severity, alarm.joint, alarm.since, alarm.time) == (severity, joint, 5, 9)
    assert statement in alarm.statement
    assert [f["alternatives"] for f in alarm.evidence["findings"]] == [["unknown"]] * len(findings["findings"])
