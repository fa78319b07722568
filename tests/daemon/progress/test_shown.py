"""The bar on a terminal, the lines elsewhere, and nothing where that is asked for."""

from __future__ import annotations

import io
import re
import sys
import threading

import pytest
from rich.console import Console

from cellwatt.progress import Told, Work, aside, listening, show_progress, stage, steps
from cellwatt.progress.shown import EVERY, Bar, Lines, Watching, duration, in_words
from tests.daemon.progress.screens import Clock

CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
ERASED, CURSOR = "\x1b[2K", "\x1b[?25h"


class Turns:
    """Lets the thread of a screen look once for each ``look``, a while later on a clock."""

    def __init__(self, clock):
        self.clock, self.asked, self.looked = clock, threading.Semaphore(0), threading.Semaphore(0)
        self.waiting = False

    def wait(self, over, seconds):
        if self.waiting:
            self.looked.release()
        self.waiting = True
        self.asked.acquire()
        self.clock.now += seconds
        return over.is_set()

    def look(self):
        self.asked.release()
        assert self.looked.acquire(timeout=30)


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def turns(clock):
    return Turns(clock)


@pytest.fixture
def watched(turns, clock):
    """Makes the work that a display shows, one look after the other."""
    screens = []

    def watch(display):
        screens.append(Watching(lambda: display, turns.wait))
        return Work(screens[-1], clock)

    yield watch
    for screen in screens:
        turns.asked.release()
        screen.close()


def test_a_line_every_five_seconds_also_of_work_that_does_not_advance(clock, turns, watched):
    out = io.StringIO()
    work = watched(Lines(out, clock))
    with listening(work):
        for i in steps(range(4), "reading recording"):
            for _ in range(3 if i == 1 else 1):  # the second takes three times as long
                before = clock.now
                turns.look()
                assert clock.now - before == EVERY == 5.0
    assert out.getvalue().splitlines() == [
        "5 s: reading recording 1 of 4; 0 %",
        "10 s: reading recording 2 of 4; 25 %, 30 s left",
        "15 s: reading recording 2 of 4; 25 %, 45 s left",
        "20 s: reading recording 2 of 4; 25 %, 60 s left",
        "25 s: reading recording 3 of 4; 50 %, 25 s left",
        "30 s: reading recording 4 of 4; 75 %, 10 s left",
    ]


def test_nothing_is_said_between_two_stages(clock, turns, watched):
    out = io.StringIO()
    work = watched(Lines(out, clock))
    with listening(work):
        with stage("reading"):
            pass
        turns.look()
        with stage("writing"):
            turns.look()
    assert out.getvalue() == "10 s: writing\n"


@pytest.fixture
def terminal():
    return Console(file=io.StringIO(), force_terminal=True, width=100, color_system=None, legacy_windows=False)


def test_the_bar_says_what_it_is_at_and_vanishes(clock, turns, watched, terminal):
    work = watched(Bar(terminal))
    with listening(work):
        for _ in steps(range(4), "fold", share=2.0):
            clock.now += 25.0
            turns.look()
    drawn = terminal.file.getvalue()
    *_, last = [line for line in CONTROL.sub("", drawn).replace("\r", "\n").split("\n") if line.strip()]
    assert re.fullmatch(r"━+ *75 %, 34 s left fold 4 of 4 *", last)
    assert len(last) <= 100
    assert drawn.endswith(ERASED)  # the terminal is as it was
    assert CURSOR in drawn


def test_a_long_text_leaves_room_for_the_time_left(clock, terminal):
    bar = Bar(Console(file=terminal.file, force_terminal=True, width=60, color_system=None))
    bar.show(Told("looking for effects in the torques, trying position [periodic] torque of joint 3", 0.5, 125.0))
    lines = re.split(r"[\r\n]", CONTROL.sub("", terminal.file.getvalue()))
    assert all(len(line) <= 60 for line in lines)
    assert "2 min left" in terminal.file.getvalue()
    bar.clear()


def test_other_output_finds_the_bar_gone(clock, turns, watched, terminal):
    work = watched(Bar(terminal))
    with listening(work), stage("replaying", 2):
        turns.look()
        with aside():
            assert terminal.file.getvalue().endswith(ERASED)
            terminal.file.write("warning: it is hot\n")
        turns.look()
        assert "replaying" in terminal.file.getvalue().rpartition("hot\n")[2]


@pytest.mark.parametrize("mistake", [ValueError, KeyboardInterrupt])
def test_an_error_or_ctrl_c_ends_the_bar_first(turns, watched, terminal, mistake):
    work = watched(Bar(terminal))
    with pytest.raises(mistake), listening(work), stage("outer"):
        for _ in steps(range(3), "inner"):
            turns.look()
            raise mistake
    assert terminal.file.getvalue().endswith(ERASED)


def test_a_reader_who_has_gone_does_not_end_the_work(clock, turns, watched):
    out = io.StringIO()
    work = watched(Lines(out, clock))
    with listening(work), stage("reading"):
        out.close()
        turns.asked.release()
        work.screen.close()  # the thread has ended by itself


def test_no_thread_is_left_and_none_is_begun_for_nothing(monkeypatch):
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
    monkeypatch.setattr(Lines, "interval", 0.01)
    written = threading.Event()
    monkeypatch.setattr(Lines, "show", lambda self, told: (print(in_words(told), file=sys.stderr), written.set()))
    with show_progress(), stage("reading", 4) as told:
        told.advance(1)
        assert written.wait(30)
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("reading; 25 %")


@pytest.mark.parametrize(
    ("seconds", "said"), [(0.2, "0 s"), (61, "61 s"), (100, "2 min"), (5400, "90 min"), (9000, "2.5 h")]
)
def test_durations(seconds, said):
    assert duration(seconds) == said
