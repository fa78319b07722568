"""``cellwatt run``: starts the processes of a cell, restarts those that die, applies new settings, and stops.

It has one thread and does nothing else, so that it can fork a process at any time in milliseconds, with
all imported modules already loaded and shared.
"""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from typing import Final

import numpy.ma  # noqa: F401  # percentiles import it: once for all processes, before they are forked

from cellwatt.config import CellConfig, load
from cellwatt.errors import CellwattError
from cellwatt.record.folder import claimed
from cellwatt.runtime import systemd
from cellwatt.runtime.assemble import chain_names, declared
from cellwatt.runtime.change import Change
from cellwatt.runtime.processes.align import align
from cellwatt.runtime.processes.collect import collect
from cellwatt.runtime.processes.judge import judge
from cellwatt.runtime.processes.rights import allow_descriptors, settle_memory
from cellwatt.runtime.processes.shared import (
    CHAINS,
    HELD,
    LARGEST,
    OTHERS,
    SLOTS,
    Alive,
    Apply,
    Assignment,
    Failed,
    InForce,
    Ready,
    Refused,
    Shared,
    Stop,
    rates,
)
from cellwatt.runtime.processes.supervised_process import SupervisedProcess
from cellwatt.runtime.processes.tell import tell
from cellwatt.runtime.processes.wakeups import Wakeups

log = logging.getLogger(__name__)

SWITCH_INTERVAL: Final = 0.0005
"""Longest time, s, for which a thread holds the interpreter while the event loop waits (Python's default: 5 ms)."""
LOOK: Final = 1.0
"""Longest time, s, between two checks of the clock."""
AGAIN: Final = 5.0
"""s until another attempt to start a process, if the PC had no memory, processes or files left."""
START: Final = 60.0
"""Longest time, s, for the processes of a reload to start: one that hangs must not block the next reload."""
END: Final = 12.0
"""Longest time, s, for one process to end."""


@dataclass(slots=True)
class _Reload:
    """A reload in progress: the new settings and their judges; ``sent``: all processes have the settings."""

    config: CellConfig
    change: Change
    generation: int
    judges: dict[int, SupervisedProcess] = field(default_factory=dict)
    sent: bool = False
    until: float = field(default_factory=lambda: time.monotonic() + START)
    """Monotonic s at which it is refused if a process has not started."""


class Supervisor:
    """The processes of one cell. ``run`` serves until SIGTERM or SIGINT, or for ``seconds``.

    SIGHUP applies the settings that ``again`` returns: by default the present settings file.
    """

    def __init__(
        self, config: CellConfig, again: Callable[[], CellConfig] | None = None, seconds: float = math.inf
    ) -> None:
        self._config = config
        self._again = again or (lambda: load(config.path))
        self._seconds = seconds
        self._until = math.inf
        """Monotonic s at which to stop."""
        self._generation = 1
        self._shared = Shared.of(*declared(config))
        self._collect = SupervisedProcess("collect", collect, self._assign)
        self._align = SupervisedProcess("align", align, self._assign)
        self._tell = SupervisedProcess("tell", tell, self._assign)
        self._judges: dict[int, SupervisedProcess] = {}
        self._judges = self._new_judges(config, self._generation)
        self._ending: list[SupervisedProcess] = []
        """Judges whose chains new judges have taken over …"""
        self._ends_by = 0.0
        """… and the time at which those that have not ended may be killed, monotonic s."""
        self._wakeups = Wakeups()
        self._reload: _Reload | None = None
        self._refused = ""
        """Reason why the changed settings file is not in force; empty if it is."""
        self._failed: Exception | None = None

    @property
    def _processes(self) -> list[SupervisedProcess]:
        held = list(self._reload.judges.values()) if self._reload is not None else []
        return [*self._serving(), *held, *self._ending]

    def run(self) -> None:
        """Serve the cell. Raises ``CellwattError`` if a process cannot start, or another daemon has the folder."""
        allow_descriptors()
        sys.setswitchinterval(SWITCH_INTERVAL)
        record = self._config.record
        with claimed(record.folder if record is not None else None, self._config.cell):
            self._run()

    def _run(self) -> None:
        settle_memory()
        with self._wakeups.listening():
            # No device is opened before all settings are checked.
            self._begin([self._tell, self._align, *self._judges.values()])
            self._begin([self._collect])
            if self._collect.ready:
                systemd.notify(READY="1")
                self._until = time.monotonic() + self._seconds
            while self._serves:
                self._turn()
                self._go_on_reloading()
            systemd.notify(STOPPING="1")
            self._shut_down()
        if self._failed is not None:
            raise self._failed

    @property
    def _serves(self) -> bool:
        return not self._wakeups.stop and self._failed is None

    @property
    def session(self) -> int:
        """Time of the start, UTC ns."""
        return self._shared.session

    def _begin(self, processes: Sequence[SupervisedProcess]) -> None:
        """Start processes and wait until all of them serve."""
        for process in processes if self._serves else ():
            self._start(process)
        while self._serves and not all(process.ready for process in processes):
            self._turn()
        for process in processes:  # messages sent before a signal arrived
            if process.control is not None and process.control.poll():
                self._hear(process)

    # processes ------------------------------------------------------------------------------------

    def _assign(self, control: Connection, restarts: int) -> Assignment:
        return Assignment(self._shared, self._config, self._generation, control, restarts)

    def _new_judges(self, config: CellConfig, generation: int) -> dict[int, SupervisedProcess]:
        """A process for each chain of stages, in free slots."""
        free = iter(slot for slot in range(SLOTS) if slot not in self._judges)
        made: dict[int, SupervisedProcess] = {}
        for slot, names in zip(free, chain_names(config, CHAINS), strict=False):
            assign = partial(self._assign_judge, config, generation, tuple(names), slot)
            made[slot] = SupervisedProcess(f"judge {'+'.join(names)}", judge, assign)
        return made

    def _assign_judge(
        self, config: CellConfig, generation: int, names: tuple[str, ...], slot: int, control: Connection, restarts: int
    ) -> Assignment:
        if not restarts:
            self._shared.frames.settle(OTHERS + slot, self._shared.frames.head)
        self._shared.results[slot].begin()
        waits = self._generation < generation
        return Assignment(self._shared, config, generation, control, restarts, stages=names, slot=slot, held=waits)

    def _start(self, process: SupervisedProcess) -> None:
        process.start([p for p in self._processes if p is not process])
        assert process.control is not None
        try:
            self._wakeups.add(process.control, lambda: self._hear(process))
            self._wakeups.add(process.exit, lambda: self._bury(process))
        except OSError:  # its end could not be noticed
            self._wakeups.forget(process.control)
            process.kill()
            process.reap()
            raise

    def _turn(self) -> None:
        """Wait for events and handle them; restart dead processes that are due."""
        now = time.monotonic()
        serving = self._serving()
        due = [p.again_at - now for p in serving if not p.alive]
        self._wakeups.wait(min([LOOK, self._until - now, *due]))
        if time.monotonic() >= self._until:  # not ``|=``, which would undo what a signal sets meanwhile
            self._wakeups.stop = True
        self._shared.clock.discipline()
        for process in serving:
            if not process.alive and time.monotonic() >= process.again_at and self._failed is None:
                try:
                    self._start(process)
                except OSError as error:  # the others continue, and one that uses too much may end
                    process.again_at = time.monotonic() + AGAIN
                    log.warning(
                        "the process %s cannot be started: %s; trying again in %.0f s",
                        process.name,
                        error.strerror,
                        AGAIN,
                    )

    def _serving(self) -> list[SupervisedProcess]:
        return [self._collect, self._align, self._tell, *self._judges.values()]

    def _hear(self, process: SupervisedProcess) -> None:
        assert process.control is not None
        try:
            message = process.control.recv()
        except (EOFError, OSError):  # the process is about to end
            self._wakeups.forget(process.control)
            return
        match message:
            case Ready():
                process.ready = True
                if process is self._tell and self._refused:  # restarted
                    self._note_refusal(self._refused)
                if process is self._tell and self._reload is not None and self._reload.sent:
                    self._reload_done(self._reload)  # restarted with the new settings
            case InForce() if self._reload is not None:
                self._reload_done(self._reload)
            case Alive():
                # systemd listens to this process only: its message confirms that it and *tell* work.
                systemd.notify(WATCHDOG="1", STATUS=message.status)
                for each in self._serving():
                    if each.alive and each.pid in message.hung:
                        log.error("the process %s does not respond: it is killed", each.name)
                        each.kill()
            case Failed():
                self._take_failure(process, message.error)

    def _take_failure(self, process: SupervisedProcess, error: Exception) -> None:
        if self._reload is not None and process in self._reload.judges.values():
            self._give_up_reload(error)
        elif process in self._serving() and self._generation == 1 and not process.restarts and not self._collect.ready:
            self._failed = error
        else:
            log.error("%s: %s", process.name, error)

    def _bury(self, process: SupervisedProcess) -> None:
        if process.control is not None and process.control.poll():
            self._hear(process)  # its last message
        self._wakeups.forget(process.control)
        self._wakeups.forget(process.exit)
        why = process.reap()
        if process in self._ending:
            self._ending.remove(process)
        elif self._reload is not None and process in self._reload.judges.values():
            self._give_up_reload(CellwattError(f"the process {process.name} ended by {why}; nothing was changed"))
        elif self._failed is None and not self._wakeups.stop and not (self._collect.ready or self._collect.restarts):
            self._failed = CellwattError(f"the process {process.name} ended by {why} at the start: the log says why")
        elif self._failed is None and not self._wakeups.stop:
            pause = max(process.again_at - time.monotonic(), 0.0)
            log.error("the process %s ended by %s; it is restarted in %.1f s", process.name, why, pause)

    # end ------------------------------------------------------------------------------------------

    def _shut_down(self) -> None:
        """End all processes in the order of the data flow, each after it has processed all of its input."""
        reload, self._reload = self._reload, None
        for process in reload.judges.values() if reload is not None else ():
            self._end(process, at_once=True)
        self._collect.send(Stop())
        self._end(self._collect)
        self._shared.raw.end()
        self._end(self._align)
        self._shared.frames.end()
        for slot, process in self._judges.items():
            self._end(process)
            self._shared.results[slot].end()
        for process in list(self._ending):
            self._end(process)
        for ring in self._shared.results:
            ring.end()
        if not self._tell.alive and self._tell.restarts and not self._tell.done and self._failed is None:
            self._start(self._tell)  # collected samples are still to be recorded
        self._end(self._tell)

    def _end(self, process: SupervisedProcess, *, at_once: bool = False) -> None:
        end = time.monotonic() + (0.0 if at_once else END)
        while process.alive and time.monotonic() < end:
            self._wakeups.wait(end - time.monotonic())
        if process.alive:
            self._kill(process, warn=not at_once)

    def _kill(self, process: SupervisedProcess, *, warn: bool = True) -> None:
        if warn:
            log.warning("the process %s did not end within %.0f s: its data in memory are lost", process.name, END)
        process.kill()
        self._bury(process)

    # reload ---------------------------------------------------------------------------------------

    def _go_on_reloading(self) -> None:
        reload = self._reload
        if reload is None:
            if self._wakeups.reload and self._slots_freed():
                self._wakeups.reload = False
                self._begin_reload()
        elif not reload.sent:
            starting = [p.name for p in (self._tell, *reload.judges.values()) if p.alive and not p.ready]
            if not starting:
                self._send(reload)  # not while *tell* starts with the old settings: it would confirm each message later
            elif time.monotonic() >= reload.until:
                self._give_up_reload(CellwattError(f"{', '.join(starting)} did not start within {START:.0f} s"))

    def _slots_freed(self) -> bool:
        """Kill judges of the reload before that still compute ``END`` s after it; return True if all have ended.

        Two processes must not write into the ring of one slot.
        """
        if time.monotonic() >= self._ends_by:
            for process in list(self._ending):
                self._kill(process)
        return not self._ending

    def _begin_reload(self) -> None:
        systemd.reloading()
        try:
            config = self._again()
            change = Change.between(self._config, config)
            if not change:
                self._config = config
                log.info("%s", change)
                self._note_refusal("")
                systemd.notify(READY="1")
                return
            rings = zip((self._shared.raw, self._shared.frames), rates(*declared(config)), strict=True)
            if any(2 * ring.size < min(HELD * rate, LARGEST) for ring, rate in rings):
                log.warning("the data rate has more than doubled since the start: restart, or a stall may lose samples")
            judges = self._new_judges(config, self._generation + 1) if change.frames else {}
        except Exception as error:  # a mistake in the code of a driver must not end the cell either
            self._refuse(error)
            return
        self._reload = _Reload(config, change, self._generation + 1, judges)
        try:
            for process in judges.values():
                self._start(process)
        except OSError as error:
            self._give_up_reload(error)

    def _send(self, reload: _Reload) -> None:
        """Send the settings to all processes, after all steps that can fail."""
        reload.sent, self._refused = True, ""
        self._config = reload.config
        if not reload.change.frames:
            self._tell.send(Apply(self._generation, reload.config))
            return
        self._generation = reload.generation
        self._ending += [process for process in self._judges.values() if process.alive]
        self._ends_by = time.monotonic() + END
        self._judges, reload.judges = reload.judges, {}
        # *align* reads them at the mark that *collect* makes when it has them; more than a pipe takes wait until then.
        for process in (self._collect, self._tell, self._align):
            process.send(Apply(reload.generation, reload.config))

    def _reload_done(self, reload: _Reload) -> None:
        log.info("%s", reload.change)
        self._reload = None
        systemd.notify(READY="1")

    def _give_up_reload(self, error: Exception) -> None:
        assert self._reload is not None
        judges, self._reload = list(self._reload.judges.values()), None
        self._ending += [process for process in judges if process.alive]
        for process in judges:
            self._end(process, at_once=True)
        self._refuse(error)

    def _refuse(self, error: Exception) -> None:
        mistake = None if isinstance(error, CellwattError | OSError) else error
        reason = str(error) if mistake is None else f"{type(error).__name__}: {error}"
        log.error("not reloaded, the old settings stay in force:\n%s", reason, exc_info=mistake)
        self._note_refusal(reason.partition("\n")[0])  # the log has the others
        systemd.notify(READY="1")

    def _note_refusal(self, reason: str) -> None:
        self._refused = reason
        self._tell.send(Refused(reason))
