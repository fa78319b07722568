"""Commands with ``--scheduler``: byte for byte what they give without, as their parts are the same wherever done."""

from __future__ import annotations

import json
from datetime import datetime, tzinfo
from pathlib import Path

import click
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt_plugins.energy.command import disaggregate
from cellwatt_plugins.faults import train_command
from cellwatt_plugins.faults.command import faults, reference
from cellwatt_plugins.models.command import predict, train
from tests.calling import called
from tests.plugins.faults.cycles.four_joints import Cycle, describe, run, write_table
from tests.plugins.models.making import Mlp, metadata
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
    if place.is_file():
        return {"": place.read_bytes()}
    return {str(p.relative_to(place)): p.read_bytes() for p in sorted(place.rglob("*")) if p.is_file()}


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
    given = ["--robot", tmp_path, *states, "--runs", tmp_path / "runs", "--json", "--no-report"]
    told, _ = both(workers, tmp_path, disaggregate, *given)
    assert len(json.loads(told)["runs"]) == 4


def test_predict(workers: str, tmp_path: Path) -> None:
    model = Mlp.random(1, inputs=3, outputs=2)
    model.save(tmp_path / "model.onnx", metadata(rate_hz=None))
    random = np.random.default_rng(0)
    names = ("voltage", "q_1", "q_2")
    tables = []
    for k in range(3):
        tables.append(tmp_path / f"poses_{k}.parquet")
        values = random.normal(size=(40 + k, 3))
        pq.write_table(pa.table(dict(zip(("supply.voltage", *names[1:]), values.T, strict=True))), tables[-1])
    told, folder = both(workers, tmp_path, predict, *tables, "--model", tmp_path / "model.onnx", "--json")
    assert [table["rows"] for table in json.loads(told)["tables"]] == [40, 41, 42]
    assert pq.read_table(folder / "poses_2.parquet").num_rows == 42


def test_train_power(workers: str, one_moment: None, tmp_path: Path) -> None:
    robot, table, _ = write_case(tmp_path, "six axes", 3, moves=3, unseen=1)
    told, folder = both(workers, tmp_path, train, "power", table, "--robot", robot, "--json")
    assert (folder / "scg.onnx").exists(), told
