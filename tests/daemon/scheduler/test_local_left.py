"""Local workers start when they are needed, and end with the command."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import psutil
import pytest

from cellwatt.scheduler import scheduled, spread
from tests.left_behind import children


def test_nothing_is_left_of_local_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    before = dict(os.environ)
    with scheduled("local:1"):
        assert spread(abs, [-1, -2], "numbers") == [1, 2]
        assert spread(pow, [2, 3], "numbers", shared=2) == [4, 9]
        process = psutil.Process()
        everyone = [process, *process.children(recursive=True)]
        assert not [c for p in everyone for c in p.net_connections() if c.status == psutil.CONN_LISTEN]
        folders = list(Path(tempfile.gettempdir()).glob("cellwatt-workers-*"))
        assert len(folders) == 1 and not list(folders[0].iterdir())
    assert dict(os.environ) == before
    assert not folders[0].exists()


def test_local_workers_start_with_the_first_items_that_are_several() -> None:
    with scheduled("local"):
        assert spread(abs, [-1], "numbers") == [1]
        assert not children()
