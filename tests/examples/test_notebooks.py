"""The notebooks run from top to bottom, and are kept without outputs."""

import ast
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt_plugins.explain.demo import plant
from cellwatt_plugins.explain.demo.command import write_files
from tests.plugins.explain import servos

from .conftest import ROOT

FOLDER = ROOT / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def run(notebook: Path) -> tuple[dict[str, Any], list[Any]]:
    """What is defined after the last cell, and what each cell shows."""
    names: dict[str, Any] = {}
    shown = []
    for cell in json.loads(notebook.read_text())["cells"]:
        if cell["cell_type"] != "code":
            continue
        assert cell["outputs"] == [] and cell["execution_count"] is None, notebook
        body = ast.parse("".join(cell["source"])).body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), notebook.name, "exec"), names)
        if last is not None:
            shown.append(eval(compile(ast.Expression(last.value), notebook.name, "eval"), names))
    return names, shown


@pytest.mark.timeout(120)
def test_look_at_a_recording(workspace):
    names, shown = run(NOTEBOOKS[0])
    assert shown[0]["board.supply.power"] == "W"
    assert len(names["frame"]) == 200 and names["power"].shape == (200, 3) and names["position"].shape == (200, 5)
    assert len(names["intervals"]) == 1 and len(names["alarms"]) == 1 and len(names["raw"]) == 100


def test_explain_a_simulation(workspace, monkeypatch):
    pytest.importorskip("mujoco")
    monkeypatch.setattr(plant, "SECONDS", (12.0, 12.0))
    concealed = write_files(workspace, ["payload"], np.random.default_rng(5))
    names, _ = run(NOTEBOOKS[1])
    [payload] = [f for f in names["found"].findings.findings if f.effect == "payload"]
    true, _ = concealed[0].numbers["mass"]
    assert payload.parameters["mass"].value == pytest.approx(true, rel=0.15)
    assert names["steps"].iloc[0].max() > 3 * names["steps"].iloc[-1].max()
    assert (workspace / "report.html").stat().st_size > 100_000


@pytest.mark.timeout(120)
def test_an_arm(workspace):
    names, shown = run(NOTEBOOKS[2])
    assert shown[0] == 3
    assert names["flange"].shape == (301, 3)
    assert names["energy"]["standby"] == pytest.approx(90 * 1.5, rel=1e-6)


@pytest.mark.timeout(120)
def test_a_desktop_arm(workspace):
    pytest.importorskip("mujoco")
    [(time, told, seen)] = servos.integrated([servos.PLANTS["gain"]])
    columns = {f"command_{j + 1}": told[:, j] for j in (0, 1)} | {f"q_{j + 1}": seen[:, j] for j in (0, 1)}
    pq.write_table(pa.table({"t": time} | columns), workspace / "log.parquet")
    (workspace / "arm.xml").write_text(servos.mjcf())
    names, _ = run(NOTEBOOKS[3])
    assert [(f.effect, f.joint) for f in names["found"].findings.findings] == [("drive_gain", 2)]
    assert "How the arm and its simulation move" in (workspace / "report.html").read_text()
