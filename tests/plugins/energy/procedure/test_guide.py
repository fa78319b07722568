"""A campaign on the terminal: the order of the steps, what is kept, what is asked again."""

import contextlib
import json

import numpy as np
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.procedure import guide as module
from cellwatt_plugins.energy.procedure.guide import LOG, Places, Plan, guide
from cellwatt_plugins.energy.procedure.log import read_log
from cellwatt_plugins.energy.procedure.recorded import Recorded
from cellwatt_plugins.energy.procedure.rest_pose import RestPose
from tests.plugins.energy.procedure.conftest import SPEEDS
from tests.plugins.energy.procedure.recording import Taped
from tests.plugins.energy.procedure.test_reading import Played, noise

POSE = RestPose(np.zeros(6), np.full(6, 0.01), 8, 3, 0.1)
LEVELS = {"controller": 54.03, "connected": 81.41, "released": 85.78}


class Operator:
    """Answers as told, else with Enter; keeps what was said."""

    def __init__(self, answers=()):
        self._answers = list(answers)
        self.said, self.asked = [], []

    def say(self, text):
        self.said.append(text)

    def show(self, text):
        pass

    def ask(self, question, answers):
        self.asked.append(question)
        answer = self._answers.pop(0) if self._answers else ""
        assert answer in answers
        return answer or answers[0]


@pytest.fixture
def campaign(plant, arm, programme, tmp_path, monkeypatch):
    """A campaign of two programs on a tape; gives what runs it."""
    taped = Taped(tmp_path / "record", plant)
    (tmp_path / "record").mkdir()
    for name, watt in LEVELS.items():
        taped.state(name, watt)
    taped.programme(0.0, *programme)
    taped.programme(5.0, *programme)
    taped.write()
    clock = iter([t for p in taped.log.programmes for t in (p.start, p.end)] * 4)
    monkeypatch.setattr(module, "time_ns", lambda: next(clock))

    def run(operator, again=(), readings=tuple(LEVELS)):
        names = iter(readings)

        @contextlib.contextmanager
        def feed():
            name = next(names)
            yield Played(LEVELS[name] + noise(700, 0.08), np.zeros(6), taped.log.states[name].start)

        plan = Plan(arm, POSE, SPEEDS, 3, 3, window=30.0)
        places = Places(feed, lambda: Recorded(tmp_path / "record", arm), tmp_path / "out")
        return guide(plan, places, operator, again)

    return run


def test_all_steps_in_the_papers_order(campaign, tmp_path):
    operator = Operator()
    log = campaign(operator)
    steps = [text.split(":")[0].strip() for text in operator.said if text.startswith("\n")]
    assert steps == ["controller", "connected", "released", "0 kg", "5 kg"]
    for name, watt in LEVELS.items():
        assert log.states[name].power == pytest.approx(watt, abs=0.03)
    out = tmp_path / "out"
    files = sorted(str(path.relative_to(out)) for path in out.rglob("*.parquet"))
    assert files == [
        "connected.parquet",
        "controller.parquet",
        "released.parquet",
        *(f"runs/{s}_{p}kg.{k}.parquet" for s in (200, 250) for p in (0, 5) for k in ("analyzer", "robot")),
    ]
    assert any("200_0kg: 3 of 3 repetitions" in text for text in operator.said)


def test_what_was_measured_is_kept_and_gone_on_with(campaign, tmp_path):
    with pytest.raises(RecordingError, match="the same command goes on"):
        campaign(Operator(["y", "a", "q"]))
    assert list(read_log(tmp_path / "out" / LOG).states) == ["controller"]
    operator = Operator()
    campaign(operator, readings=("connected", "released"))
    assert not any(text.startswith("\ncontroller") for text in operator.said)
    assert list(read_log(tmp_path / "out" / LOG).states) == ["controller", "connected", "released"]


def test_a_reading_is_repeated_on_demand(campaign):
    operator = Operator(["y", "r"])
    campaign(operator, readings=("controller", "controller", "connected", "released"))
    told = [text.split(":")[0] for text in operator.said if "drift" in text]
    assert told == ["controller", "controller", "connected", "released"]


def test_one_step_once_more(campaign, tmp_path):
    campaign(Operator())
    before = (tmp_path / "out" / LOG).read_text()
    operator = Operator()
    campaign(operator, again=["5kg"])
    steps = [text.split(":")[0].strip() for text in operator.said if text.startswith("\n")]
    assert steps == ["5 kg"]
    assert len(json.loads(before)["programmes"]) == len(json.loads((tmp_path / "out" / LOG).read_text())["programmes"])


def test_the_campaign_of_another_robot_is_not_gone_on_with(campaign, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / LOG).write_text('{"robot": "FR3"}')
    with pytest.raises(RecordingError, match=r"is a campaign of FR3, robot\.yaml describes UR5e"):
        campaign(Operator())


@pytest.mark.parametrize(("text", "said"), [("{", "not valid YAML"), ('{"robot": 3}', "robot: ")])
def test_a_log_that_cannot_be_read(tmp_path, text, said):
    (tmp_path / LOG).write_text(text)
    with pytest.raises(RecordingError, match=said):
        read_log(tmp_path / LOG)
