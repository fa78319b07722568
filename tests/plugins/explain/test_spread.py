"""Explaining on the workers of a scheduler: the bytes of serial work, whatever becomes of the workers."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from cellwatt.errors import RecordingError
from cellwatt.scheduler import scheduled, spread
from cellwatt_plugins.explain import api
from cellwatt_plugins.explain.explain import Explained
from cellwatt_plugins.explain.model import save_model

UNHURRIED = 1e6
"""s: what is found is not to depend on how quick this machine is."""

pytestmark = pytest.mark.leaves_behind  # connections between processes that end with the scheduler


@pytest.fixture(scope="module")
def workers() -> Iterator[None]:
    with scheduled("local:2"):
        spread(abs, [1, 2], "start")
        yield


def explained(cell: Path) -> Explained:
    recordings, simulations = (sorted(cell.glob(f"*.{kind}.parquet")) for kind in ("recording", "simulation"))
    return api.explain(recordings, robot=cell, simulation=simulations, seconds=UNHURRIED)


def written(found: Explained, folder: Path) -> tuple[str, str]:
    save_model(found.model, folder / "model.yaml")
    return repr(found.as_json()), (folder / "model.yaml").read_text()


@pytest.fixture(scope="module")
def serial(cell: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    found = explained(cell)
    assert [(f.effect, f.joint) for f in found.findings.findings] == [("torque_offset", 3)]
    return written(found, tmp_path_factory.mktemp("serial"))


@pytest.mark.slow
def test_workers_find_the_same_to_the_last_bit(
    cell: Path, serial: tuple[str, str], workers: None, tmp_path: Path
) -> None:
    assert written(explained(cell), tmp_path) == serial


def test_the_first_recording_that_cannot_be_used_is_named_as_in_serial_work(
    cell: Path, workers: None, tmp_path: Path
) -> None:
    """Two simulations have changed places."""
    recordings, simulations = (sorted(cell.glob(f"*.{kind}.parquet")) for kind in ("recording", "simulation"))
    changed = [shutil.copy(path, tmp_path / f"{i}.parquet") for i, path in zip((1, 0, 2), simulations, strict=True)]
    with pytest.raises(RecordingError, match="run_01: the recording does not follow its simulation"):
        api.explain(recordings, robot=cell, simulation=sorted(changed))
