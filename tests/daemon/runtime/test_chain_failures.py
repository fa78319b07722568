"""A stage that breaks pauses longer each time, by the time of the frames, and is made anew."""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import pairwise

import pytest

from cellwatt import CellInfo
from cellwatt.runtime.chain import Chain
from tests.daemon.runtime.fakes import (
    JUDGES,
    LAYOUT,
    AfterStage,
    FakeStage,
    JudgeSettings,
    alarm,
    frames_of,
    prediction,
)

LONGEST = 60


def chain_of(**classes: type[FakeStage]) -> Chain:
    def maker(name, stage):
        return lambda: stage(name, JudgeSettings(), LAYOUT, CellInfo("plant", "weld", None, None))

    makers = {name: maker(name, stage) for name, stage in classes.items()}
    return Chain(makers, {name: make() for name, make in makers.items()})


def breaks(*_):
    raise ValueError("a singular matrix")


def seconds_of_tries(chain, until):
    """Whole seconds at which the stage was given frames; it breaks each time."""
    tries = []
    for second in range(until):
        before = chain.status()["judge"]["failures"]
        chain.process(frames_of(50 * second, second=second))
        if chain.status()["judge"]["failures"] > before:
            tries.append(second)
    return tries


def test_each_pause_is_twice_the_one_before_up_to_a_minute():
    chain = chain_of(judge=FakeStage)
    JUDGES["judge"].give = breaks
    tries = seconds_of_tries(chain, 300)
    pauses = [b - a for a, b in pairwise(tries)]
    assert pauses == [1, 2, 4, 8, 16, 32, LONGEST, LONGEST, LONGEST]


def test_one_that_cannot_be_made_anew_is_tried_again(caplog):
    chain = chain_of(judge=FakeStage)
    JUDGES["judge"].give = breaks
    chain.process(frames_of(0, second=0.0))
    JUDGES["judge"].refuse = FileNotFoundError("model.onnx")
    chain.process(frames_of(1, second=1.0))
    assert "stage judge cannot be created again: model.onnx" in caplog.text
    assert chain.status()["judge"]["error"] == "FileNotFoundError: model.onnx"
    JUDGES["judge"].refuse, JUDGES["judge"].give = None, lambda *_: [alarm()]
    assert chain.process(frames_of(2, second=2.9)) == [], "its pause is 2 s now"
    assert chain.process(frames_of(3, second=3.0)) == [alarm(stage="judge")]
    assert chain.status()["judge"] | {"state": "ok", "error": None, "failures": 2} == chain.status()["judge"]


def test_one_that_needs_a_broken_one_gets_nothing_of_it():
    seen = []
    chain = chain_of(judge=FakeStage, after=AfterStage)
    JUDGES["judge"].give = lambda *_: [prediction("judge", 1)]
    JUDGES["after"].give = lambda _, upstream: seen.append(list(upstream)) or ()
    chain.process(frames_of(0, second=0.0))
    JUDGES["judge"].give = breaks
    chain.process(frames_of(1, second=0.02))
    assert seen == [[prediction("judge", 1)], []]


def test_alarms_of_a_stage_that_broke_are_taken_back():
    chain = chain_of(judge=FakeStage)
    JUDGES["judge"].give = lambda *_: [alarm("heat"), alarm("noise"), alarm("noise", active=False)]
    chain.process(frames_of(0, second=0.0))
    JUDGES["judge"].give = breaks
    (over,) = chain.process(frames_of(1, second=1.0))
    assert (over.id, over.active, over.time) == ("heat", False, 1_000_000_000)
    assert over.statement == "Withdrawn, as stage judge restarts: Joint 2: heat."
    assert chain.process(frames_of(2, second=2.0)) == []


def test_the_error_of_a_stage_is_one_line_of_plain_text(caplog):
    caplog.set_level(logging.CRITICAL, logger="cellwatt.runtime.chain")  # a test report is UTF-8
    chain = chain_of(judge=FakeStage)

    def names_a_file(*_):
        raise OSError("no file of \udcff,\n  see the log")

    JUDGES["judge"].give = names_a_file
    chain.process(frames_of(0))
    assert chain.status()["judge"]["error"] == "OSError: no file of  ,   see the log"


@pytest.mark.parametrize(
    ("given", "error"),
    [
        (replace(alarm(), severity="critical"), "ValueError: 1 validation error for Alarm severity Input should be"),
        (replace(alarm(), evidence={"curve": object()}), "object cannot be recorded"),
        ("heat", "KeyError: <class 'str'>"),
    ],
)
def test_a_result_that_no_process_could_read_is_a_failure_of_its_stage(given, error):
    chain = chain_of(judge=FakeStage, after=AfterStage)
    JUDGES["judge"].give = lambda *_: [given]
    JUDGES["after"].give = lambda *_: [alarm("noise")]
    assert chain.process(frames_of(0)) == [alarm("noise", stage="after")]
    assert error in chain.status()["judge"]["error"]
