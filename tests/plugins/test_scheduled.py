"""Commands with ``--scheduler``: byte for byte what they give without, as their parts are the same wherever done."""

from __future__ import annotations

import json
from datetime import datetime, tzinfo
from pathlib import Path

import click
import pytest

from cellwatt_plugins.energy.command import disaggregate
from cellwatt_plugins.faults import train_command
from cellwatt_plugins.faults.command import faults, reference
from cellwatt_plugins.models.command import train
from tests.calling import called
from tests.plugins.faults.cycles.four_joints import Cycle, describe, run, write_table
from tests.plugins.models.power.emulated_arm import write_case

codes_of = train_command.train_codes
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture
def workers() -> str:
    """Two processes of this machine."""
    return "local:2"


@pytest.fixture
def one_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let models be made at the same time, which they carry."""

    class Standing(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> datetime:
            return datetime(2026, 1, 1, tzinfo=tz)

    for module in ("cellwatt_plugins.models.metadata", "cellwatt_plugins.models.static.exported"):
        monkeypatch.setattr(f"{module}.datetime", Standing)


def both(workers: str, folder: Path, command: click.Command, *words: object) -> tuple[str, Path]:
    """Output of a command, and the folder ``a`` that it wrote; the same by the workers, into ``b``."""
    a, b = folder / "a", folder / "b"
    here = called(command, *words, "--out", a)
    there = called(command, *words, "--out", b, "--scheduler", workers)
    assert here == there.replace(str(b), str(a))
    assert contents(a) == contents(b)
    return here, a


def contents(place: Path) -> dict[str, bytes]:
    """The files below a place, but the page, which tells when and how it was made."""
    if place.is_file():
        return {"": place.read_bytes()}
    files = [p for p in sorted(place.rglob("*")) if p.is_file() and p.name != "report.html"]
    return {str(p.relative_to(place)): p.read_bytes() for p in files}


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tables of healthy cycles and of others, the description of their arm, and the reference."""
    folder = tmp_path_factory.mktemp("cell")
    describe(folder)
    runs = {"healthy_1": "AbBAaBABaAbBA", "healthy_2": "AbBAaBABaAbBA", "x": "AB", "y": "BbA"}
    for seed, (name, tasks) in enumerate(runs.items()):
        cycles = [Cycle(task.upper(), 0.6 if task.islower() else 1.0) for task in tasks]
        write_table(folder / f"{name}.parquet", run(cycles, seed=seed))
    called(reference, *sorted(folder.glob("healthy_*")), "--robot", folder, "--out", folder / "reference.yaml")
    return folder


def test_reference(cell: Path, workers: str, tmp_path: Path) -> None:
    told, _ = both(workers, tmp_path, reference, *sorted(cell.glob("healthy_*")), "--robot", cell, "--json")
    assert [task["name"] for task in json.loads(told)["tasks"]] == ["task_1", "task_2"]


def test_faults(cell: Path, workers: str, tmp_path: Path) -> None:
    given = ["judge", cell / "x.parquet", cell / "y.parquet", "--reference", cell / "reference.yaml", "--robot", cell]
    told, _ = both(workers, tmp_path, faults, *given, "--json")
    assert [cycle["status"] for cycle in json.loads(told)["cycles"]] == ["healthy"] * 5


def test_faults_train(cell: Path, workers: str, tmp_path: Path) -> None:
    given = ["train", "--reference", cell / "reference.yaml", "--robot", cell, cell / "healthy_1.parquet"]
    told, folder = both(workers, tmp_path, faults, *given)
    assert len(list(folder.glob("*-codes.onnx"))) > 2, told


def test_disaggregate(workers: str, tmp_path: Path) -> None:
    from energy.arms import Case
    from energy.plant import write_campaign

    write_campaign(Case("small", 21, speeds=(400.0, 1400.0), repetitions=2), tmp_path)
    states = [word for s in ("controller", "connected", "released") for word in (f"--{s}", tmp_path / f"{s}.parquet")]
    given = ["--robot", tmp_path, *states, "--runs", tmp_path / "runs", "--json"]
    told, _ = both(workers, tmp_path, disaggregate, *given)
    assert len(json.loads(told)["runs"]) == 4


def test_train_power(workers: str, one_moment: None, tmp_path: Path) -> None:
    robot, table, _ = write_case(tmp_path, "six axes", 3, moves=3, unseen=1)
    told, folder = both(workers, tmp_path, train, "power", table, "--robot", robot, "--json")
    assert (folder / "scg.onnx").exists(), told
