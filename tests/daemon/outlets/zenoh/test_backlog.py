from __future__ import annotations

from dataclasses import replace

from cellwatt import Interval, Prediction
from cellwatt.outlets.zenoh.backlog import ALARMS_KEPT, RESULTS_KEPT, Backlog
from tests.daemon.outlets.zenoh.fake_cell import EPOCH, alarm, frames


def backlog(frame_bytes: float = 1e6) -> Backlog:
    return Backlog(EPOCH, frame_bytes)


def test_each_topic_has_numbers_of_its_own() -> None:
    kept = backlog()
    interval = Interval("arm", 9, 1, 2, (), (), (), ())
    for number in range(3):
        assert kept.add(alarm(number))[0].sequence == number
    assert kept.add(interval)[0].sequence == 0
    assert kept.add(Prediction("power", 50, (5,), {}, {}))[0].sequence == 0
    assert kept.add(Prediction("current", 50, (5,), {}, {}))[0].sequence == 0
    mark, paths = kept.add(Prediction("power", 51, (6,), {}, {}))
    assert (mark.sequence, mark.session, mark.arrival, paths) == (1, EPOCH, 6, ("prediction/power",))


def test_alarms_stay_while_active_and_go_when_cleared() -> None:
    kept = backlog()
    kept.add(alarm(1))
    kept.add(alarm(2))
    kept.add(replace(alarm(1), statement="worse"))
    assert [(a.id, a.statement[:5], m.sequence) for m, a in kept.active()] == [
        ("alarm-2", "Joint", 1),
        ("alarm-1", "worse", 2),
    ]
    kept.add(alarm(2, active=False))
    assert [a.id for _, a in kept.active()] == ["alarm-1"]
    kept.add(alarm(3, active=False))
    assert [a.id for _, a in kept.cleared(1)] == ["alarm-3"]
    assert [a.id for _, a in kept.cleared(9)] == ["alarm-2", "alarm-3"]
    assert kept.cleared(0) == []


def test_an_alarm_that_changes_its_severity_is_told_where_it_was() -> None:
    kept = backlog()
    assert kept.add(alarm(1))[1] == ("alarm/error/joint_fault",)
    assert kept.add(alarm(1, severity="warning"))[1] == ("alarm/warning/joint_fault", "alarm/error/joint_fault")
    assert kept.add(alarm(1, severity="warning", active=False))[1] == ("alarm/warning/joint_fault",)


def test_results_are_kept_up_to_a_number_of_each_topic() -> None:
    kept = backlog()
    for number in range(ALARMS_KEPT + 3):
        kept.add(alarm(number))
        kept.add(Interval("arm", number, 1, 2, (), (), (), ()))
    found = kept.results("alarm", EPOCH, 0, ALARMS_KEPT)
    assert [m.sequence for m, _ in found] == list(range(3, ALARMS_KEPT))
    assert len(kept.results("interval", EPOCH, 0, 2 * ALARMS_KEPT)) == RESULTS_KEPT
    assert [m.sequence for m, _ in kept.results("alarm", EPOCH, 10, 2)] == [10, 11]
    assert kept.results("alarm", EPOCH + 1, 0, 9) == []
    assert kept.results("task", EPOCH, 0, 9) == []


def test_frames_are_kept_up_to_a_number_of_bytes() -> None:
    size = 1000 + 10 * (8 + 2 * 8 + 2 + 2 * 8)  # what objects take, and the numbers
    kept = backlog(3 * size)
    for first in range(0, 50, 10):
        kept.add_frames(frames(first, 10))
    assert [m.sequence for m, _ in kept.frames(EPOCH, 0, 99)] == [20, 30, 40]
    assert [m.sequence for m, _ in kept.frames(EPOCH, 35, 5)] == [30]
    assert kept.frames(EPOCH + 1, 0, 99) == []


def test_frames_that_never_came_are_a_hole_in_their_numbers() -> None:
    kept = backlog()
    kept.add_frames(frames(0, 10))
    mark = kept.add_frames(frames(15, 5))
    assert (mark.session, mark.sequence) == (EPOCH, 15)
    assert [m.sequence for m, _ in kept.frames(EPOCH, 0, 99)] == [0, 15]
    assert kept.frames(EPOCH, 10, 5) == []
    assert kept.recorded(EPOCH)


def test_frames_whose_numbers_go_back_begin_a_new_numbering() -> None:
    kept = backlog()
    assert kept.add_frames(frames(0, 10)).session == EPOCH
    mark = kept.add_frames(frames(5, 5))
    assert (mark.session, mark.sequence) == (EPOCH + 1, 5)
    assert kept.frames(EPOCH, 0, 99) == []
    assert len(kept.frames(EPOCH + 1, 0, 99)) == 1
    assert not kept.recorded(EPOCH)  # two frames may have one number there
    assert kept.recorded(EPOCH - 1)


def test_frames_have_the_numbers_of_the_cell_also_where_results_begin_anew() -> None:
    kept = Backlog(EPOCH + 7, 1e6, numbered=EPOCH)
    assert kept.add(alarm(0))[0].session == EPOCH + 7
    assert kept.add_frames(frames(3, 2)).session == EPOCH


def test_numbers_of_frames_begin_where_the_cell_is() -> None:
    assert backlog().add_frames(frames(500, 2)).sequence == 500


def test_frames_of_a_outlet_that_was_ended_are_still_given_by_the_one_after_it() -> None:
    before, after = backlog(), backlog()
    kept = before.add_frames(frames(10, 5))
    after.succeed(before)
    assert [mark for mark, _ in after.frames(EPOCH, 12, 1)] == [kept]
    following = after.add_frames(frames(15, 5))
    assert (following.session, following.sequence) == (kept.session, kept.end)
    assert [mark for mark, _ in after.frames(EPOCH, 0, 99)] == [kept, following]
