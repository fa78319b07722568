"""The supervisor where the PC has no room for another process, and where a reload follows on another."""

from __future__ import annotations

import errno
import math
import os
import selectors
import time
from unittest.mock import Mock

import pytest

from cellwatt.errors import CellwattError
from cellwatt.runtime.processes.part import SupervisedProcess
from cellwatt.runtime.processes.supervisor import Supervisor
from tests.daemon.runtime.fakes import config_of, stages


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
