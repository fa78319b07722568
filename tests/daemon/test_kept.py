"""What a process had to wait for, as the kernel tells it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cellwatt import kept

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
    monkeypatch.setitem(kept._open, "/proc/stat", descriptor)
    assert kept._stolen_ns() == (298_500 * MS, 296_400 * MS)
    stat.write_text("cpu  6869866 1482864 503294 4100512 7886 0 30169 0 0 0\n")
    assert kept._stolen_ns() == (), "a PC of its own loses nothing to others"
    os.close(descriptor)
