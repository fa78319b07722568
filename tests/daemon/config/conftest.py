from __future__ import annotations

from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import pytest

from cellwatt.config import CellConfig, load
from tests.daemon.config.fakes import entry_points
from tests.daemon.conftest import Registered

VALID = """\
site: plant-1
cell: weld-3
robot: testarm
sources:
  arm: {driver: arm, host: 192.0.2.10, rate: 500 Hz}
  board:
    driver: meter
    port: /dev/ttyUSB0
frames: {rate: 50 Hz, latency: 100 ms}
stages:
  cut: {}
  power: {stage: net, file: model.txt}
  watch: {tolerance: 10 %}
record: {folder: recordings, keep: 20 GB}
zenoh: {connect: [tcp/127.0.0.1:7447]}
"""


@pytest.fixture(autouse=True)
def _fake_parts(registered: Registered) -> None:
    registered(entry_points)


@pytest.fixture
def real_parts(registered: Registered, _fake_parts: None) -> None:
    """The drivers, stages and outlets that are installed, in place of the fakes."""
    registered(lambda group: metadata.entry_points(group=group))


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    """The valid file beside the model that it names."""
    (tmp_path / "model.txt").write_text("testarm\n")
    file = tmp_path / "cell.yaml"
    file.write_text(VALID, encoding="utf-8")
    return file


@pytest.fixture
def load_text(cell_file: Path) -> Callable[..., CellConfig]:
    """Loads a text in place of the valid file."""

    def read(text: str | bytes, **environ: str) -> CellConfig:
        cell_file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load(cell_file, environ)

    return read
