"""The supervisor where the PC has no room for another process, and where a reload follows on another."""

from __future__ import annotations

import errno
import math
import os
import selectors
import signal
import time
from itertools import count
from unittest.mock import Mock

import pytest

from cellwatt.errors import CellwattError
from cellwatt.runtime.change import Change
from cellwatt.runtime.processes.part import SupervisedProcess
from cellwatt.runtime.processes.shared import Assignment, Ready
from cellwatt.runtime.processes.supervisor import Supervisor, _Reload
from tests.daemon.runtime.fakes import config_of, stages
from tests.patience import wait_until


def test_a_process_that_cannot_be_begun_now_is_tried_again_and_ends_nobody(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    daemon = Supervisor(config_of())
    daemon._selector = selectors.DefaultSelector()
    daemon._align.again_at = 0.0
    monkeypatch.setattr(os, "fork", Mock(side_effect=OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))))
    daemon._turn()
    assert "the process align cannot be started: Resource temporarily unavailable" in caplog.text
    assert daemon._align.again_at > time.monotonic() and not daemon._align.alive


def test_new_judges_begin_when_those_of_the_reload_before_have_left_their_slots(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    daemon = Supervisor(config_of(stages=stages("heat")), lambda: config_of(stages=stages("heat", heat="new")))
    daemon._judges = {1: daemon._judges.pop(0)}
    old = SupervisedProcess("judge heat", lambda assignment: assignment.control.poll(None), daemon._assign)
    with daemon._signals() as daemon._selector:
        daemon._start(old)
        daemon._ending, daemon._reload_asked, daemon._ends_by = [old], True, math.inf
        daemon._go_on_reloading()
        assert daemon._reload is None and old.alive, "the daemon serves while it waits"
        daemon._ends_by = 0.0
        daemon._go_on_reloading()
        assert daemon._reload is not None and list(daemon._reload.judges) == [0]
        assert not old.alive and not daemon._ending
        daemon._give_up_reload(CellwattError("the end of the test"))


def test_a_signal_is_heard_whenever_it_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = time.monotonic
    for call in count():
        daemon = Supervisor(config_of())
        calls = count()

        def monotonic(call: int = call, calls: count[int] = calls) -> float:
            if next(calls) == call:
                os.kill(os.getpid(), signal.SIGTERM)
            return clock()

        with daemon._signals() as daemon._selector, monkeypatch.context() as patched:
            patched.setattr(time, "monotonic", monotonic)
            patched.setattr(daemon, "_wait", lambda seconds: None)
            daemon._turn()
        if next(calls) <= call:
            break
        assert daemon._stop_asked, f"a signal during call {call} of the clock was lost"
    assert call > 1


def _fails(assignment: Assignment) -> None:
    raise CellwattError("no such model")


def _serves(assignment: Assignment) -> None:
    assignment.control.send(Ready())
    assignment.control.poll(None)


def test_a_judge_that_fails_as_another_becomes_ready_ends_the_reload_alone() -> None:
    daemon = Supervisor(config_of())
    config = config_of(stages=stages("heat", "wear"))
    judges = {n: SupervisedProcess(f"judge {n}", main, daemon._assign) for n, main in enumerate((_fails, _serves))}
    with daemon._signals() as daemon._selector:
        daemon._reload = _Reload(config, Change.between(daemon._config, config), 2, judges)
        for judge in judges.values():
            daemon._start(judge)
        wait_until(lambda: len(daemon._selector.select(0)) == 3)  # both messages, and the end of one
        daemon._wait(0.0)
        assert daemon._reload is None and daemon._failed is None and not daemon._processes[3:]
