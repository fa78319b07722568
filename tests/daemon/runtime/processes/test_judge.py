"""The process that judges: what it makes of alarms whose stage is gone."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence

import numpy as np

from cellwatt import Alarm, Frames
from cellwatt.ring import ItemReader, ItemWriter, Mark
from cellwatt.runtime.assemble import declared
from cellwatt.runtime.processes.judge import judge
from cellwatt.runtime.processes.shared import OTHERS, TELL, Assignment, Shared
from tests.daemon.runtime.fakes import JUDGES, alarm, config_of, stages
from tests.patience import PATIENCE

CONFIG = config_of(stages=stages("heat"))
STEP = 20_000_000


def frames_of(layout, first: int, n: int) -> Frames:
    time = np.arange(first, first + n, dtype=np.int64) * STEP
    shape = (n, len(layout.channels))
    return Frames(layout, first, time, np.zeros(shape), np.zeros(shape, np.uint8), np.zeros(shape, np.int64))


def alarms_of(before: Sequence[Alarm], *, restarts: int, replaced: bool = False) -> list[Alarm]:
    """What a judge adds to the ``before`` of the one that it follows, given ten frames."""
    streams, layout = declared(CONFIG)
    shared = Shared.of(streams, layout)
    told = ItemWriter(shared.results[0])
    for item in before:
        told.put(item)
    shared.frames.settle(OTHERS, shared.frames.head)
    frames = ItemWriter(shared.frames)
    frames.put(frames_of(layout, 0, 10))
    if replaced:
        frames.put(Mark(2))
    shared.frames.end()
    context = multiprocessing.get_context("fork")
    _ours, theirs = context.Pipe()
    assignment = Assignment(shared, CONFIG, 1, theirs, restarts, stages=("heat",))
    process = context.Process(target=judge, args=(assignment,))
    process.start()
    process.join(PATIENCE)
    assert process.exitcode == 0
    given = [i for i in ItemReader(shared.results[0], TELL).items() if isinstance(i, Alarm)]
    assert given[: len(before)] == list(before)
    return given[len(before) :]


def test_alarms_of_stages_that_died_with_their_process_are_taken_back() -> None:
    before = [alarm("heat"), alarm("noise"), alarm("noise", active=False)]
    (over,) = alarms_of(before, restarts=1)
    assert (over.id, over.active, over.time) == ("heat", False, 9 * STEP)
    assert over.statement == "Withdrawn, as the stage that raised it begins anew: Joint 2: heat."


def test_a_first_judge_takes_nothing_back() -> None:
    assert alarms_of([alarm("heat")], restarts=0) == []


def test_alarms_of_stages_that_others_replace_are_taken_back() -> None:
    JUDGES["heat"].give = lambda *_: [alarm("heat")]
    raised, over = alarms_of([], restarts=0, replaced=True)
    assert (raised.active, over.active, over.id) == (True, False, "heat")


def test_at_the_end_of_the_daemon_alarms_stay() -> None:
    JUDGES["heat"].give = lambda *_: [alarm("heat")]
    assert [a.active for a in alarms_of([], restarts=0)] == [True]
