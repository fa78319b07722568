"""A folder as a reader of the page and the notebooks has it: recordings in ``rec``, the arm in ``arm``."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwatt import Batch, FrameChannel, Interval, Layout
from tests.blocks import frames_of
from tests.daemon.record.making import SESSION, batch_of, write_chunks
from tests.daemon.record.test_roundtrip import RESULTS

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    (tmp_path / "rec").mkdir()
    channels = [FrameChannel(f"arm.joint_{i}.position", "rad", "continuous", "linear") for i in (1, 2, 3)]
    channels.append(FrameChannel("board.supply.power", "W", "continuous", "average"))
    t = np.arange(200) * 0.02
    values = np.column_stack([*(np.sin(t + i) for i in range(3)), 100 + 10 * np.cos(t)])
    frames = frames_of(Layout(tuple(channels), 50.0), 0, SESSION + np.arange(200) * 20_000_000, values)
    raw: Batch = batch_of(0, 100)
    results = [replace(r, closed=True) if isinstance(r, Interval) else r for r in RESULTS]
    write_chunks(tmp_path / "rec", [[raw, frames], results])
    shutil.copytree(ROOT / "examples" / "notebooks" / "arm", tmp_path / "arm")
    monkeypatch.chdir(tmp_path)
    return tmp_path
