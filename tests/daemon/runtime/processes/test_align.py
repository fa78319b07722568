"""The process that makes frames: it reads as often as the present settings ask."""

from __future__ import annotations

from multiprocessing import Pipe

import pytest

from cellwatt.config import FrameSettings
from cellwatt.ring import ItemWriter, Mark
from cellwatt.runtime.assemble import declared
from cellwatt.runtime.processes import align
from cellwatt.runtime.processes.shared import Apply, Assignment, Shared
from tests.daemon.runtime.fakes import config_of
from tests.daemon.runtime.test_following_aligner import batches


def test_frames_are_made_as_often_as_new_settings_ask(monkeypatch: pytest.MonkeyPatch) -> None:
    config, quick = config_of(), config_of(frames=FrameSettings(latency=0.04))
    shared = Shared.of(*declared(config))
    ours, theirs = Pipe()
    raw, first, second = ItemWriter(shared.raw), *batches(2)
    periods: list[float] = []

    def next_moment(period: float, after: float) -> float:
        periods.append(period)
        if len(periods) == 1:
            ours.send(Apply(2, quick))
            raw.put(Mark(2))
            raw.put(second)
        else:
            raw.end()
        return 0.0

    monkeypatch.setattr(align, "next_moment", next_moment)
    monkeypatch.setattr(align, "settle_memory", lambda: None)
    raw.put(first)
    align._Aligning(Assignment(shared, config, 1, theirs)).run()
    assert periods == [config.gather(awaited=False), quick.gather(awaited=False)] == [0.04, 0.016]
