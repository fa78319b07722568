"""What a process had to wait for, and one that wants to run and is not let."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cellwatt import processor
from cellwatt.processor import spent, starved
from tests.patience import wait_until

MS = 1_000_000


def test_what_the_hypervisor_keeps_is_read_core_by_core(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stat = tmp_path / "stat"
    stat.write_text(
        "cpu  6869866 1482864 503294 4100512 7886 0 30169 59491 0 0\n"
        "cpu0 3438818 721920 252935 2064240 4579 0 13696 29850 0 0\n"
        "cpu1 3431048 760943 250359 2036271 3306 0 16472 29640 0 0\n"
        "intr 12345 0 0\n"
    )
    descriptor = os.open(stat, os.O_RDONLY)
    monkeypatch.setitem(processor._open, "/proc/stat", descriptor)
    assert processor._stolen_ns() == (298_500 * MS, 296_400 * MS)
    stat.write_text("cpu  6869866 1482864 503294 4100512 7886 0 30169 0 0 0\n")
    assert processor._stolen_ns() == (), "a PC of its own loses nothing to others"
    os.close(descriptor)


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
        wait_until(lambda: spent(busy) > 0, "a tick of computing")
        wait_until(lambda: starved(busy, 0.0, 1e6), "it to want to run")
        assert not starved(busy, 0.0, 1e-6), "it has computed all the time"
    assert not starved(busy, 0.0, 1e6), "it is gone"
    with process("print(flush=True)\ninput()") as idle:
        wait_until(lambda: not starved(idle, 0.0, 1e6), "it to wait for a line")
