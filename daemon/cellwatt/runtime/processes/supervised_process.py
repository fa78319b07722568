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
"""A process that ran for this long, s, is restarted at once."""
BROKEN: Final = 1
"""Exit code of a process that ended by an unexpected exception."""


@dataclass(slots=True)
class SupervisedProcess:
    """A process that runs ``main`` with the assignment from ``make``, which gets its end of the control pipe."""

    name: str
    main: Callable[[Assignment], None]
    make: Callable[[Connection, int], Assignment]
    pid: int = 0
    exit: int = -1
    """A descriptor that becomes readable when the process ends."""
    control: Connection | None = None
    ready: bool = False
    done: bool = False
    """True if the last run ended with exit code 0."""
    restarts: int = 0
    again_at: float = math.inf
    """Monotonic s at which to restart it."""
    _began: float = 0.0
    _failures: int = 0

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        return self.pid > 0

    def start(self, others: Iterable[SupervisedProcess]) -> None:
        """Fork the process and close the descriptors of ``others`` in it. Raises ``OSError`` if resources run out."""
        ours, theirs = Pipe()
        assignment = self.make(theirs, self.restarts)
        self._began, self.ready = time.monotonic(), False
        pid = os.fork()
        if not pid:
            try:
                ours.close()
                for other in others:
                    other.let_go()
                _serve(self.name, self.main, assignment)
            finally:
                os._exit(BROKEN)
        theirs.close()
        try:
            self.exit = os.pidfd_open(pid)
        except OSError:
            os.kill(pid, signal.SIGKILL)  # its end could not be noticed
            os.waitpid(pid, 0)
            raise
        self.pid, self.control = pid, ours

    def let_go(self) -> None:
        """Close the supervisor's descriptors of this process."""
        if self.control is not None:
            self.control.close()
        if self.exit >= 0:
            os.close(self.exit)
        self.control, self.exit, self.pid = None, -1, 0

    def send(self, message: Any) -> None:
        """Send a message to the process, unless it has just ended."""
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
        """Reap a process that has ended; return the signal or exit code."""
        _, status = os.waitpid(self.pid, 0)
        self.let_go()
        code = os.waitstatus_to_exitcode(status)
        self.done = code == 0
        now = time.monotonic()
        self._failures = 0 if now - self._began > STEADY else self._failures + 1
        pause = 0.0 if self._failures <= 1 else min(FIRST_PAUSE * 2 ** min(self._failures - 2, 10), LONGEST_PAUSE)
        self.again_at = now + pause
        self.restarts += 1
        return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def _serve(name: str, main: Callable[[Assignment], None], assignment: Assignment) -> None:
    """Run the forked process and exit."""
    code = BROKEN
    try:
        # The supervisor handles these signals; a terminal or systemd sends them to every process.
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        main(assignment)
        code = 0
    except CellwattError as error:
        error.__context__ = None  # an exception group that contains the error itself, which some picklers refuse
        assignment.control.send(Failed(error))
    except (EOFError, BrokenPipeError):
        log.debug("%s: the supervisor is gone", name)
    except BaseException:
        log.exception("the process %s failed", name)
    finally:
        logging.shutdown()
        os._exit(code)
