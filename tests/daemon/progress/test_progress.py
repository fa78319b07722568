"""Stages inside one another, and how they are shown: a bar on a terminal, lines elsewhere, nothing where asked for."""

from __future__ import annotations

import io
import re
import sys
import threading

import pytest

from cellwatt.progress import Work, WorkState, aside, listening, show_progress, stage, steps
from cellwatt.progress.work import Display, duration

CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
ERASED = "\x1b[2K"


class Clock:
    """A clock that moves when it is told to; the thread of the work looks once for each ``look``."""

    def __init__(self):
        self.now, self.waiting = 0.0, False
        self.asked, self.looked = threading.Semaphore(0), threading.Semaphore(0)

    def __call__(self):
        return self.now

    def wait(self, over, seconds):
        if self.waiting:
            self.looked.release()
        self.waiting = True
        self.asked.acquire()
        self.now += seconds
        return over.is_set()

    def look(self):
        self.asked.release()
        assert self.looked.acquire(timeout=30)


@pytest.fixture
def clock():
    found = Clock()
    yield found
    found.asked.release()


@pytest.fixture
def watched(clock):
    """Makes the work that a display shows, one look after the other."""

    class Looked(Work):
        def close(self):
            clock.asked.release()
            super().close()

    return lambda display: Looked(display, clock, clock.wait)


@pytest.fixture
def out():
    return io.StringIO()


@pytest.fixture
def work(clock, watched, out):
    with listening(watched(Display(out, clock))) as work:
        yield work


def test_a_loop_in_a_loop(work, clock):
    told = []
    for _ in steps(range(5), "fold"):
        for _ in steps(["a", "b"], "epoch"):
            told.append(work.state())
            clock.now += 3.0
    assert told[0] == WorkState("fold 1 of 5, epoch 1 of 2", 0.0, None)
    # Half of the second of five folds: 3 of 10 epochs of 3 s.
    assert told[3].text == "fold 2 of 5, epoch 2 of 2"
    assert told[3].fraction == pytest.approx(0.3)
    assert told[3].left == pytest.approx(21.0)
    assert work.state() is None


def test_labels_and_loops_of_unknown_length(work):
    told = [work.state().text for _ in steps(["spring", "gap"], "trying", str)]
    assert told == ["trying spring (1 of 2)", "trying gap (2 of 2)"]
    told = [work.state() for _ in steps(iter("ab"), "part")]
    assert told == [WorkState("part 1", None, None), WorkState("part 2", None, None)]
    with stage("searching"):
        assert [work.state().fraction for _ in steps(range(2), "trying")] == [None, None]


def test_stages_do_their_share_of_what_is_around_them(work, clock):
    with stage("", 100.0):
        with stage("reading", 1, share=20.0):
            clock.now = 1.0
        assert work.state() == WorkState("", 0.2, pytest.approx(4.0))
        with stage("writing", 8, share=80.0) as told:
            told.advance(2)
            assert work.state() == WorkState("writing", pytest.approx(0.4), pytest.approx(1.5))
            told.advance(15)
            assert work.state() == WorkState("writing", 1.0, 0.0)


def test_stages_end_however_they_are_left(work):
    with pytest.raises(ValueError, match="broken"), stage("outer"):
        for _ in steps(range(3), "inner"):
            break
        assert work.state().text == "outer"
        for _ in steps(range(3), "inner"):
            raise ValueError("broken")
    assert work.state() is None

    def read(name):
        with stage(name):
            yield 1

    both = read("first"), read("second")  # two readers in turns: the one that began first ends first
    assert [next(each) for each in both] == [1, 1]
    assert work.state().text == "first, second"
    for each in both:
        each.close()
    assert work.state() is None


def test_nobody_listens():
    assert list(steps(iter("abc"), "letter")) == ["a", "b", "c"]
    with stage("reading", 3) as told, aside():
        told.advance()
    assert told.done == 1


def test_a_line_every_five_seconds_also_of_work_that_does_not_advance(clock, work, out):
    for i in steps(range(4), "reading recording"):
        for _ in range(3 if i == 1 else 1):  # the second takes three times as long
            clock.look()
    with stage("writing"):
        clock.look()
    assert out.getvalue().splitlines() == [
        "5 s: reading recording 1 of 4; 0 %",
        "10 s: reading recording 2 of 4; 25 %, 30 s left",
        "15 s: reading recording 2 of 4; 25 %, 45 s left",
        "20 s: reading recording 2 of 4; 25 %, 60 s left",
        "25 s: reading recording 3 of 4; 50 %, 25 s left",
        "30 s: reading recording 4 of 4; 75 %, 10 s left",
        "35 s: writing",
    ]


@pytest.fixture
def drawn(watched, out):
    with listening(watched(Display(out, live=True))):
        yield out.getvalue


def test_the_bar_says_what_it_is_at_and_vanishes(clock, drawn):
    for _ in steps(range(4), "looking for effects in the torques, trying position", share=2.0):
        clock.now += 25.0
        clock.look()
    lines = [line for line in re.split(r"[\r\n]", CONTROL.sub("", drawn())) if line.strip()]
    assert re.fullmatch(r"━+ *75 %, 34 s left looking for effects .*", lines[-1])
    assert all(len(line) < 80 for line in lines)
    assert drawn().endswith(ERASED)  # the terminal is as it was


def test_other_output_finds_the_bar_gone(clock, drawn, out):
    with stage("replaying", 2):
        clock.look()
        with aside():
            assert drawn().endswith(ERASED)
            out.write("warning: it is hot\n")
        clock.look()
        assert "replaying" in drawn().rpartition("hot\n")[2]


@pytest.mark.parametrize("mistake", [ValueError, KeyboardInterrupt])
def test_an_error_or_ctrl_c_ends_the_bar_first(clock, drawn, mistake):
    with pytest.raises(mistake), stage("outer"):
        for _ in steps(range(3), "inner"):
            clock.look()
            raise mistake
    assert drawn().endswith(ERASED)


def test_a_reader_who_has_gone_does_not_end_the_work(clock, work, out):
    with stage("reading"):
        out.close()
        clock.asked.release()
        work.close()  # the thread has ended by itself


def test_no_thread_is_left_and_none_is_begun_for_nothing():
    def watchers():
        return [thread for thread in threading.enumerate() if thread.name == "progress"]

    with show_progress():
        assert not watchers()
        with stage("reading"):
            assert len(watchers()) == 1
    assert not watchers()
    with show_progress(quiet=True), stage("reading"):
        assert not watchers()


def test_where_no_terminal_is_there_are_lines(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as on many build servers: no reason to draw into their logs
    monkeypatch.setattr(Display, "interval", 0.01)
    written = threading.Event()
    monkeypatch.setattr(Display, "show", lambda self, told: (print(told.figures, file=sys.stderr), written.set()))
    with show_progress(), stage("reading", 4) as told:
        told.advance(1)
        assert written.wait(30)
    said = capsys.readouterr()
    assert (said.out, said.err[:4]) == ("", "25 %")


def test_durations():
    assert [duration(s) for s in (0.2, 61, 100, 5400, 9000)] == ["0 s", "61 s", "2 min", "90 min", "2.5 h"]
