"""One process of the daemon as its supervisor sees it."""

from __future__ import annotations

import logging
import math
import os
import signal
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, Final

from cellwatt.errors import CellwattError
from cellwatt.runtime.processes.shared import Assignment, Failed

log = logging.getLogger(__name__)

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 60.0  # s
STEADY: Final = 2.0
"""A process that served for so long, s, is begun again at once."""
BROKEN: Final = 1
"""Exit code of a process that ended by a mistake of ours."""


@dataclass(slots=True)
class SupervisedProcess:
    """A process: ``main`` gets its assignment from ``make``, which is given the process's end of the control pipe."""

    name: str
    main: Callable[[Assignment], None]
    make: Callable[[Connection, int], Assignment]
    pid: int = 0
    exit: int = -1
    """A descriptor that can be read once the process has ended."""
    control: Connection | None = None
    ready: bool = False
    done: bool = False
    """Its last run came to its end by itself."""
    restarts: int = 0
    again_at: float = math.inf
    """When to begin it again, monotonic s."""
    _began: float = 0.0
    _failures: int = 0

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        return self.pid > 0

    def start(self, others: Iterable[SupervisedProcess]) -> None:
        """Fork the process; what belongs to ``others`` is closed in it. Raises ``OSError`` where there is no room."""
        ours, theirs = Pipe()
        assignment = self.make(theirs, self.restarts)
        self._began, self.ready = time.monotonic(), False
        pid = os.fork()
        if not pid:
            ours.close()
            for other in others:
                other.let_go()
            _serve(self.name, self.main, assignment)
        theirs.close()
        try:
            self.exit = os.pidfd_open(pid)
        except OSError:
            os.kill(pid, signal.SIGKILL)  # nobody would learn of its end
            os.waitpid(pid, 0)
            raise
        self.pid, self.control = pid, ours

    def let_go(self) -> None:
        """Close what the supervisor holds of this process."""
        if self.control is not None:
            self.control.close()
        if self.exit >= 0:
            os.close(self.exit)
        self.control, self.exit, self.pid = None, -1, 0

    def send(self, message: Any) -> None:
        """Say something to the process; one that has just ended will not hear it."""
        if self.control is not None:
            try:
                self.control.send(message)
            except OSError:
                log.debug("%s has ended", self.name)

    def kill(self) -> None:
        """End the process at once."""
        if self.alive:
            os.kill(self.pid, signal.SIGKILL)

    def reap(self) -> str:
        """Collect a process that has ended; gives what it ended by."""
        _, status = os.waitpid(self.pid, 0)
        self.let_go()
        code = os.waitstatus_to_exitcode(status)
        self.done = code == 0
        now = time.monotonic()
        self._failures = 0 if now - self._began > STEADY else self._failures + 1
        pause = 0.0 if self._failures <= 1 else min(FIRST_PAUSE * 2 ** (self._failures - 2), LONGEST_PAUSE)
        self.again_at = now + pause
        self.restarts += 1
        return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def _serve(name: str, main: Callable[[Assignment], None], assignment: Assignment) -> None:
    """The life of the process that was forked."""
    code = BROKEN
    try:
        # Who stops the daemon tells the supervisor; a terminal or systemd tells every process.
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        main(assignment)
        code = 0
    except CellwattError as error:
        error.__context__ = None  # a group of tasks that holds the error itself: not every pickler takes that
        assignment.control.send(Failed(error))
    except (EOFError, BrokenPipeError):
        log.debug("%s: the supervisor is gone", name)
    except BaseException:
        log.exception("the process %s broke", name)
    finally:
        logging.shutdown()
        os._exit(code)
