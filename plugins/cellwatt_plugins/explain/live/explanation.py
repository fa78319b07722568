"""``cellwatt explain`` as a separate process, which nothing waits for, and which is stopped at its limits."""

from __future__ import annotations

import json
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from os import PRIO_PROCESS, setpriority
from pathlib import Path
from typing import Any

from cellwatt.child import MODULE, ends_with_parent
from cellwatt.errors import RecordingError
from cellwatt.files import COMPUTED, read_text

NICENESS = 19
"""Lowest priority: every other process on the PC comes first."""
RECORDING, SIMULATION, ROBOT = "recording.parquet", "simulation.parquet", "robot.yaml"
LOG = "explain.log"


@dataclass(frozen=True)
class Outcome:
    """Outcome of an explanation: the content of its findings.json, or the reason for its failure."""

    folder: Path
    findings: Mapping[str, Any] | None
    failure: str = ""

    @property
    def report(self) -> str:
        """Link to the report."""
        return (self.folder / "report.html").as_uri()


class Explanation:
    """One running explanation of the recording in ``folder``, limited to ``limit`` s and ``memory`` bytes.

    ``simulation`` is the file it is compared with; None: the law in the folder's robot.yaml.
    """

    def __init__(self, folder: Path, simulation: Path | None, limit: float, memory: float) -> None:
        """Start the process. Raises ``RecordingError`` if it cannot be started."""
        self.folder = folder
        self._limit, self._memory = limit, memory
        command = [*MODULE, "cellwatt.commands", "explain", str(folder / RECORDING)]
        command += [] if simulation is None else ["--simulation", str(simulation)]
        command += ["--robot", str(folder / ROBOT), "--out", str(folder)]
        try:
            with (folder / LOG).open("wb") as log:
                self._process = subprocess.Popen(
                    command,
                    cwd=folder,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=log,
                    preexec_fn=ends_with_parent(signal.SIGKILL),
                )
        except OSError as error:
            raise RecordingError(f"cellwatt explain cannot be started: {error.strerror or error}") from error
        self._deadline = time.monotonic() + limit
        self.gives_way = _restrain(self._process.pid, limit)
        """True if the process has low priority; a service may not be permitted to set it."""

    def poll(self) -> Outcome | None:
        """The outcome, or None while the process runs."""
        code = self._process.poll()
        if code is None:
            return self._too_much()
        if code == -signal.SIGXCPU:
            return Outcome(self.folder, None, self._late())
        if code != 0:
            return Outcome(self.folder, None, self._last_words(code))
        try:
            return Outcome(self.folder, json.loads(read_text(self.folder / "findings.json", COMPUTED)))
        except (OSError, ValueError) as error:
            return Outcome(self.folder, None, f"its findings cannot be read: {error}")

    def stop(self) -> None:
        """Kill the process; its unfinished output is not needed."""
        self._process.kill()
        self._process.wait()

    def _too_much(self) -> Outcome | None:
        if time.monotonic() > self._deadline:
            reason = self._late()
        elif _resident(self._process.pid) > self._memory:
            reason = f"it needed more than {self._memory * 1e-6:.0f} MB (explain.memory)"
        else:
            return None
        self.stop()
        return Outcome(self.folder, None, reason)

    def _late(self) -> str:
        return f"it took longer than {self._limit:.0f} s (explain.limit)"

    def _last_words(self, code: int) -> str:
        how = f"exit code {code}" if code > 0 else f"signal {-code}"
        try:
            lines = (self.folder / LOG).read_text(errors="replace").split("\n")
        except OSError:
            return how
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return f"{last.removeprefix('cellwatt: ')} ({how})" if last else how


def new_folder(parent: Path, name: str, keep: int) -> Path:
    """Create the folder, which a replay may already have created; keep only the ``keep`` newest of the same stage.

    ``name`` ends in a time after its last ``-``. Raises ``RecordingError`` if it cannot be created.
    """
    folder = parent / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stem = name.rpartition("-")[0]
        ours = [p for p in parent.glob(f"{stem}-*Z") if p.name.rpartition("-")[0] == stem]
        # The new folder counts as the newest even if the clock went back, or older frames are replayed.
        for old in sorted(ours, key=lambda p: (p == folder, p.name))[:-keep]:
            shutil.rmtree(old)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be created: {error.strerror or error}: set explain.folder") from error
    return folder


def _restrain(process: int, limit: float) -> bool:
    """Lower a child's priority and limit its CPU time, in case no frames come to stop it; return whether that was
    permitted."""
    seconds = int(limit) + 1
    try:
        resource.prlimit(process, resource.RLIMIT_CPU, (seconds, seconds + 1))  # SIGXCPU, then SIGKILL
        resource.prlimit(process, resource.RLIMIT_CORE, (0, 0))
        setpriority(PRIO_PROCESS, process, NICENESS)
    except PermissionError:
        return False
    except ProcessLookupError:  # the process has ended
        pass
    return True


def _resident(process: int) -> int:
    """Bytes of memory that a process uses; 0 if it has ended."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0
    return pages * resource.getpagesize()
