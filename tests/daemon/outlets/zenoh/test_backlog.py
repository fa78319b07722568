from __future__ import annotations

from pathlib import Path

import pytest

from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings
from cellwatt.outlets.zenoh.backlog import Backlog
from tests.daemon.outlets.zenoh.fake_cell import EPOCH, FakeView, alarm, frames


def backlog(frame_bytes: float = 1e6) -> Backlog:
    return Backlog(EPOCH, frame_bytes)


def test_frames_are_kept_up_to_a_number_of_bytes() -> None:
    size = 1000 + 10 * (8 + 2 * 8 + 2 + 2 * 8)  # what objects take, and the numbers
    kept = backlog(3 * size)
    for first in range(0, 50, 10):
        kept.add_frames(frames(first, 10))
    assert [m.sequence for m, _ in kept.frames(EPOCH, 0, 99)] == [20, 30, 40]
    assert [m.sequence for m, _ in kept.frames(EPOCH, 35, 5)] == [30]
    assert kept.frames(EPOCH + 1, 0, 99) == []


def test_frames_have_the_numbers_of_the_cell_also_where_results_begin_anew() -> None:
    kept = Backlog(EPOCH + 7, 1e6, numbered=EPOCH)
    assert kept.add(alarm(0))[0].session == EPOCH + 7
    assert kept.add_frames(frames(3, 2)).session == EPOCH


def test_frames_of_a_outlet_that_was_ended_are_still_given_by_the_one_after_it() -> None:
    before, after = backlog(), backlog()
    kept = before.add_frames(frames(10, 5))
    after.succeed(before)
    assert [mark for mark, _ in after.frames(EPOCH, 12, 1)] == [kept]
    following = after.add_frames(frames(15, 5))
    assert (following.session, following.sequence) == (kept.session, kept.end)
    assert [mark for mark, _ in after.frames(EPOCH, 0, 99)] == [kept, following]


@pytest.mark.parametrize(("recorded", "most"), [(True, 0.5e6), (False, 4e6)])
def test_frames_that_the_record_has_take_little_memory(
    monkeypatch: pytest.MonkeyPatch, recorded: bool, most: float
) -> None:
    view = FakeView()
    view.record_folder = Path("/record")
    monkeypatch.setattr(view, "config", lambda: {"record": {"frames": recorded}})
    outlet = ZenohOutlet("zenoh", ZenohSettings(listen=("tcp/127.0.0.1:0",)), view)
    for first in range(0, 200_000, 2000):
        outlet.offer(frames(first, 2000))
    kept = [block for _, block in outlet._backlog.frames(view.session, 0, 200_000)]
    size = sum(array.nbytes for block in kept for array in (block.time, block.values, block.quality, block.bound))
    assert 0.7 * most < size <= most
