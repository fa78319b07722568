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

from cellwatt.config import FrameSettings
from cellwatt.errors import CellwattError
from cellwatt.ring import ItemWriter, Mark
from cellwatt.runtime.change import Change
from cellwatt.runtime.processes.align import align
from cellwatt.runtime.processes.shared import Alive, Apply, Assignment, Failed, Ready
from cellwatt.runtime.processes.supervised_process import LONGEST_PAUSE, SupervisedProcess
from cellwatt.runtime.processes.supervisor import Supervisor, _Reload
from tests.daemon.runtime.fakes import FakeDriver, config_of, sources, stages
from tests.patience import PATIENCE, wait_until


def test_a_process_that_cannot_be_begun_now_is_tried_again_and_ends_nobody(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    daemon = Supervisor(config_of())
    daemon._wakeups._selector = selectors.DefaultSelector()
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
    with daemon._wakeups.listening():
        daemon._start(old)
        daemon._ending, daemon._wakeups.reload, daemon._ends_by = [old], True, math.inf
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

        with daemon._wakeups.listening(), monkeypatch.context() as patched:
            patched.setattr(time, "monotonic", monotonic)
            patched.setattr(daemon._wakeups, "wait", lambda seconds: None)
            daemon._turn()
        if next(calls) <= call:
            break
        assert daemon._wakeups.stop, f"a signal during call {call} of the clock was lost"
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
    with daemon._wakeups.listening():
        daemon._reload = _Reload(config, Change.between(daemon._config, config), 2, judges)
        for judge in judges.values():
            daemon._start(judge)
        wait_until(lambda: len(daemon._wakeups._selector.select(0)) == 3)  # both messages, and the end of one
        daemon._wakeups.wait(0.0)
        assert daemon._reload is None and daemon._failed is None and not daemon._processes[3:]


def test_new_settings_wait_until_a_tell_that_starts_with_the_old_ones_serves() -> None:
    """Else its first message confirms them, and its second one those of the next reload, whose judges nobody ends."""
    daemon, config = Supervisor(config_of()), config_of(outlets={})
    tell = daemon._tell = SupervisedProcess("tell", _serves, daemon._assign)
    with daemon._wakeups.listening():
        daemon._start(tell)
        daemon._reload = _Reload(config, Change.between(daemon._config, config), 2)
        daemon._go_on_reloading()
        assert not daemon._reload.sent
        while not tell.ready:
            daemon._wakeups.wait(PATIENCE)
        daemon._go_on_reloading()
        assert daemon._reload.sent
        daemon._kill(tell, warn=False)


def _hears_new_settings(assignment: Assignment) -> None:
    assert isinstance(assignment.control.recv(), Apply)


def _begins_new_settings(assignment: Assignment) -> None:
    _hears_new_settings(assignment)
    raw = ItemWriter(assignment.shared.raw)
    raw.put(Mark(2))
    raw.end()


@pytest.mark.timeout(60)
def test_new_settings_may_be_larger_than_a_pipe_takes() -> None:
    """A server of OPC UA with two thousand tags."""
    daemon, config = Supervisor(config_of()), config_of(text="#" * 4_000_000)
    mains = {"collect": _begins_new_settings, "align": align, "tell": _hears_new_settings}
    made = [SupervisedProcess(name, main, daemon._assign) for name, main in mains.items()]
    daemon._collect, daemon._align, daemon._tell = made
    with daemon._wakeups.listening():
        for process in made:
            daemon._start(process)
        daemon._send(_Reload(config, Change((), (), (), frames=True, units=False), 2))
        while any(process.alive for process in made):
            daemon._wakeups.wait(PATIENCE)
    assert all(process.done for process in made)


def test_new_settings_do_not_wait_for_a_tell_that_cannot_start() -> None:
    daemon, config = Supervisor(config_of()), config_of(outlets={})
    daemon._reload = _Reload(config, Change.between(daemon._config, config), 2)
    daemon._go_on_reloading()
    assert daemon._reload.sent


def _hangs(assignment: Assignment) -> None:
    assignment.control.poll(None)


def test_a_judge_that_does_not_start_is_refused_and_the_next_reload_goes_on() -> None:
    """It reads its model from a share that does not respond."""
    config = config_of(stages=stages("heat"))
    read: list[str] = []
    daemon = Supervisor(config_of(), lambda: read.append("the corrected file") or config_of())  # type: ignore[func-returns-value]
    judges = {0: SupervisedProcess("judge heat", _hangs, daemon._assign)}
    with daemon._wakeups.listening():
        daemon._reload = _Reload(config, Change.between(daemon._config, config), 2, judges)
        daemon._start(judges[0])
        daemon._wakeups.reload = True
        daemon._go_on_reloading()
        assert judges[0].alive and not daemon._refused and not read
        daemon._reload.until = 0.0
        daemon._go_on_reloading()
        assert not judges[0].alive and daemon._reload is None and not daemon._ending
        assert daemon._refused == "judge heat did not start within 60 s"
        daemon._go_on_reloading()
        assert read == ["the corrected file"] and not daemon._refused


def test_a_stop_amid_a_reload_is_no_failed_reload(caplog: pytest.LogCaptureFixture) -> None:
    daemon, config = Supervisor(config_of()), config_of(stages=stages("heat", "wear"))
    judges = {n: SupervisedProcess(f"judge {n}", _serves, daemon._assign) for n in (0, 1)}
    with daemon._wakeups.listening():
        daemon._reload = _Reload(config, Change.between(daemon._config, config), 2, judges)
        for judge in judges.values():
            daemon._start(judge)
        daemon._wakeups.stop = True
        daemon._shut_down()
    assert not any(judge.alive for judge in judges.values()) and not caplog.text


def test_a_mistake_in_a_driver_ends_the_reload_alone(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    daemon = Supervisor(config_of(), again=lambda: config_of(sources=sources("arm", "supply")))
    monkeypatch.setattr(FakeDriver, "streams", property(lambda driver: {}[driver.name]))
    daemon._begin_reload()
    assert daemon._reload is None and "not reloaded" in caplog.text and "Traceback" in caplog.text
    assert daemon._refused == "KeyError: 'arm'"
    daemon._refuse(AssertionError())
    assert daemon._refused.startswith("AssertionError"), "a mistake without words is a refusal, too"


def test_settings_that_send_more_than_the_rings_hold_are_warned_about(caplog: pytest.LogCaptureFixture) -> None:
    """Rings are made at the start only."""
    fast = config_of(sources=sources(*(f"arm_{n}" for n in range(30))), frames=FrameSettings(rate=1000.0))
    daemon = Supervisor(config_of(), again=lambda: fast)
    with daemon._wakeups.listening():
        daemon._begin_reload()
    assert "restart, or a stall may lose samples" in caplog.text
    daemon = Supervisor(fast, again=lambda: config_of(outlets={}))
    caplog.clear()
    with daemon._wakeups.listening():
        daemon._begin_reload()
    assert "restart" not in caplog.text


def test_a_process_that_hangs_is_killed_and_restarted(caplog: pytest.LogCaptureFixture) -> None:
    daemon = Supervisor(config_of())
    daemon._collect.ready = True
    align = daemon._align = SupervisedProcess("align", _hangs, daemon._assign)
    with daemon._wakeups.listening():
        daemon._start(align)
        hung = Alive("", (align.pid,))
        tell = SupervisedProcess("tell", lambda assignment: assignment.control.send(hung), daemon._assign)
        daemon._start(tell)
        while align.alive or tell.alive:
            daemon._wakeups.wait(PATIENCE)
        assert "the process align ended by signal SIGKILL; it is restarted" in caplog.text
        align.again_at = 0.0
        daemon._turn()
        assert align.alive
        daemon._kill(align, warn=False)


def _breaks(assignment: Assignment) -> None:
    raise KeyError("joint_7")


@pytest.mark.timeout(60)
def test_a_process_that_breaks_before_a_device_is_opened_refuses_the_start() -> None:
    """A stage with a mistake in its code; else the devices would never be opened, and nothing would be recorded."""
    daemon = Supervisor(config_of())
    judge = SupervisedProcess("judge heat", _breaks, daemon._assign)
    daemon._judges = {0: judge}
    with daemon._wakeups.listening():
        daemon._begin([judge])
    assert str(daemon._failed) == "the process judge heat ended by exit code 1 at the start: the log says why"


def test_a_process_that_has_failed_for_days_is_still_restarted() -> None:
    daemon = Supervisor(config_of())
    align = daemon._align = SupervisedProcess("align", _fails, daemon._assign, restarts=2000, _failures=2000)
    with daemon._wakeups.listening():
        daemon._start(align)
        while align.alive:
            daemon._wakeups.wait(PATIENCE)
    assert align.again_at - align._began >= LONGEST_PAUSE


def _hears(assignment: Assignment) -> None:
    assignment.control.send(Ready())
    assignment.control.send(Failed(CellwattError(f"told {assignment.control.recv()}")))


def test_a_tell_that_is_restarted_is_told_that_the_settings_are_refused(caplog: pytest.LogCaptureFixture) -> None:
    daemon = Supervisor(config_of())
    with daemon._wakeups.listening():
        daemon._refuse(CellwattError("a change of site needs a restart"))
        tell = daemon._tell = SupervisedProcess("tell", _hears, daemon._assign, restarts=1)
        daemon._start(tell)
        while tell.alive:
            daemon._wakeups.wait(PATIENCE)
    assert "told Refused(reason='a change of site needs a restart')" in caplog.text
