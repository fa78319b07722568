"""A process that wants to run and is not let, beside one that computes and one that waits for something else."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from cellwatt.starved import starved
from tests.patience import wait_until


@contextmanager
def process(program: str) -> Iterator[int]:
    with subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as run:
        try:
            assert run.stdout is not None
            run.stdout.readline()
            yield run.pid
        finally:
            run.kill()


def test_only_who_wants_to_run_and_hardly_runs_is_starved() -> None:
    with process("print(flush=True)\nwhile True: pass") as busy:
        wait_until(lambda: starved(busy, 0.0, 1e6), "it to want to run")
        assert not starved(busy, 0.0, 1e-6), "it has computed all the time"
    assert not starved(busy, 0.0, 1e6), "it is gone"
    with process("print(flush=True)\ninput()") as idle:
        wait_until(lambda: not starved(idle, 0.0, 1e6), "it to wait for a line")
