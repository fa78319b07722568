"""The examples of the pages, word for word, on an arm whose torque is known in closed form."""

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.plugins.explain.simulators.arms import FULL, TwoLinks, moves

PAGES = Path(__file__).resolve().parents[4] / "docs" / "simulators"


def run(page, folder, monkeypatch):
    """Runs the page's block of Python that reads a plan, in a folder with one; the torque that it writes, (N, 2) Nm."""
    monkeypatch.chdir(folder)
    columns = {"t": 0.01 * np.arange(200)}
    for name, values in zip(("q", "qd", "qdd"), moves(), strict=True):
        columns |= {f"{name}_{j + 1}": values[:, j] for j in range(2)}
    pq.write_table(pa.table(columns), "run_01.plan.parquet")
    blocks = re.findall(r"```python\n(.*?)```", (PAGES / page).read_text(), re.DOTALL)
    (code,) = (block for block in blocks if "plan.parquet" in block)
    exec(compile(code, page, "exec"), {})
    table = pq.read_table("run_01.simulation.parquet")
    assert table.column_names[:2] == ["t", "q_1"]
    return np.column_stack([table["tau_1"], table["tau_2"]])


def test_mujoco(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    (tmp_path / "arm.xml").write_text(FULL.mjcf())
    # The page takes the sign of the velocity as it is, the arm turns over within 4 mrad/s.
    fast = np.all(np.abs(moves()[1]) > 0.05, axis=1)
    torque = run("mujoco.md", tmp_path, monkeypatch)
    np.testing.assert_allclose(torque[fast], FULL.torque(*moves())[fast], atol=1e-6)


def test_drake(tmp_path, monkeypatch):
    pytest.importorskip("pydrake", reason="Drake is not installed")
    arm = TwoLinks(damping=(1.5, 0.4))
    (tmp_path / "arm.urdf").write_text(arm.urdf())
    np.testing.assert_allclose(run("drake.md", tmp_path, monkeypatch), arm.torque(*moves()), atol=1e-6)
