"""A dask scheduler and its workers as processes of their own, on loopback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from cellwatt.child import ends_with_parent
from tests.patience import wait_until

ROOT = Path(__file__).parents[3]
QUIET = {
    "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
    "DASK_DISTRIBUTED__SCHEDULER__HTTP__ROUTES": "[]",
    "DASK_DISTRIBUTED__WORKER__HTTP__ROUTES": "[]",
}


class Scheduler:
    """``dask scheduler`` in a folder; ``process`` is to be killed by whoever likes."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder, self._stack = folder, stack
        about = folder / "scheduler.json"
        at = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(about)]
        self.process = self._started("dask_scheduler", "--dashboard-address", "127.0.0.1:0", *at)
        self._about = about

    @property
    def address(self) -> str:
        return str(wait_until(self._told, "a scheduler")["address"])

    def work(self, *options: str, path: Path | None = None) -> subprocess.Popen[bytes]:
        """Start ``dask worker``, with packages of ``path`` before all others."""
        more = ["--nthreads", "1", "--no-dashboard", "--dashboard-address", "127.0.0.1:0", "--memory-limit", "0"]
        kept = ["--host", "127.0.0.1", "--local-directory", str(self._folder), *more, *options]
        return self._started("dask_worker", self.address, *kept, path=path)

    def python(self, program: str, *arguments: object) -> subprocess.Popen[bytes]:
        """Start a program that gives work; its standard error is a pipe."""
        command = [sys.executable, "-c", program, *map(str, arguments)]
        return subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, preexec_fn=ends_with_parent())

    def _told(self) -> Any:
        try:
            return json.loads(self._about.read_text())
        except (OSError, ValueError):
            return None

    def _started(self, module: str, *options: str, path: Path | None = None) -> subprocess.Popen[bytes]:
        paths = os.pathsep.join(map(str, filter(None, (path, ROOT))))
        with (self._folder / f"{module}.log").open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", *options],
                cwd=self._folder,
                env=os.environ | QUIET | {"PYTHONPATH": paths},
                stdout=log,
                stderr=log,
                preexec_fn=ends_with_parent(),
            )
        self._stack.callback(_end, process)
        return process


@contextmanager
def scheduler(folder: Path) -> Iterator[Scheduler]:
    with ExitStack() as stack:
        yield Scheduler(folder, stack)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(5)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
