"""The process that judges: its word when its stages begin, alarms of stages that go, frames it is too slow for."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cellwatt import Alarm, Frames, Prediction
from cellwatt.ring import ItemReader, ItemWriter, Mark, Status
from cellwatt.runtime.assemble import declared
from cellwatt.runtime.processes.judge import QUEUED_FRAMES, judge
from cellwatt.runtime.processes.shared import OTHERS, TELL, Assignment, Shared
from tests.blocks import frames_of
from tests.daemon.runtime.fakes import JUDGES, alarm, config_of, prediction, stages
from tests.patience import PATIENCE

CONFIG = config_of(stages=stages("heat"))
STEP = 20_000_000


def zeros(layout, first: int, n: int) -> Frames:
    return frames_of(layout, first, np.arange(first, first + n) * STEP, np.zeros((n, len(layout.channels))))


def said_by_a_judge(*, held: bool = False, replaced: bool = False, blocks: int = 1) -> list[Any]:
    """All that a judge gives for blocks of ten frames, each after the mark of its settings, as if frames began anew."""
    streams, layout = declared(CONFIG)
    shared = Shared.of(streams, layout)
    shared.frames.settle(OTHERS, shared.frames.head)
    frames = ItemWriter(shared.frames)
    for block in range(blocks):
        frames.put(Mark(1))
        frames.put(zeros(layout, 10 * block, 10))
    if replaced:
        frames.put(Mark(2))
    shared.frames.end()
    context = multiprocessing.get_context("fork")
    _ours, theirs = context.Pipe()
    assignment = Assignment(shared, CONFIG, 1, theirs, stages=("heat",), held=held)
    process = context.Process(target=judge, args=(assignment,))
    process.start()
    process.join(PATIENCE)
    assert process.exitcode == 0
    return list(ItemReader(shared.results[0], TELL).items())


def alarms_in(said: Sequence[Any]) -> list[Alarm]:
    return [i for i in said if isinstance(i, Alarm)]


@pytest.mark.parametrize("held", [False, True])
def test_a_judge_says_once_and_first_that_its_stages_begin(held: bool) -> None:
    JUDGES["heat"].give = lambda *_: [alarm("heat")]
    first, *others = said_by_a_judge(held=held, blocks=2)
    assert first == Status({"begun": ["heat"]})
    assert not any(isinstance(i, Status) and "begun" in i.figures for i in others), "align may begin again, not it"
    assert alarms_in(others) == 2 * [alarm("heat", stage="heat")]


def test_alarms_of_stages_that_others_replace_are_taken_back() -> None:
    JUDGES["heat"].give = lambda *_: [alarm("heat")]
    raised, over = alarms_in(said_by_a_judge(replaced=True))
    assert (raised.active, over.active, over.id, over.time) == (True, False, "heat", 9 * STEP)
    assert over.statement == "Withdrawn, as stage heat restarts: Joint 2: heat."


def test_a_judge_that_is_behind_drops_the_oldest_and_counts_them() -> None:
    JUDGES["heat"].give = lambda frames, _: [prediction("heat", frames.sequence)]
    said = said_by_a_judge(blocks=QUEUED_FRAMES // 10 + 30)
    judged = [i.sequence for i in said if isinstance(i, Prediction)]
    assert judged == list(range(290, QUEUED_FRAMES + 300, 10)), "all that was waiting when it came up to date, in order"
    last = [i for i in said if isinstance(i, Status)][-1].figures["stages"]["heat"]
    assert (last["dropped"], last["frames"], last["waiting"]) == (290, QUEUED_FRAMES + 10, 0)


def test_results_that_are_too_large_to_be_passed_on_are_counted() -> None:
    JUDGES["heat"].give = lambda frames, _: [
        replace(prediction("large", frames.sequence), outputs={"power": (0.5,) * 200_000}),
        prediction("heat", frames.sequence),
    ]
    said = said_by_a_judge(blocks=3)
    assert [(i.model, i.sequence) for i in said if isinstance(i, Prediction)] == [("heat", n) for n in (0, 10, 20)]
    assert [i for i in said if isinstance(i, Status)][-1].figures["refused"] == 3
