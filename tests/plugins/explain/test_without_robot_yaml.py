"""``cellwatt explain LOG --simulation arm.xml``, and its model without MuJoCo's file."""

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from cellwatt.tables import read_table, write_table
from cellwatt_plugins.explain.command import explain, simulate
from tests.plugins.explain.input.test_simulators_log import GRIPPER, LINKS, logged, motion
from tests.plugins.explain.logs import numbered

pytest.importorskip("mujoco")


def test_the_simulators_file_is_enough(tmp_path, monkeypatch):
    assert "grip" in GRIPPER
    noise = 0.05 * np.random.default_rng(3).standard_normal((1200, 2))
    torque = LINKS.torque(*motion()[1:])
    motors = '<motor joint="shoulder"/><motor joint="elbow"/>'
    logged(tmp_path, motors, torque + noise)
    monkeypatch.chdir(tmp_path)
    words = ["log.parquet", "--simulation", "arm.xml", "--out", "out", "--time", "2", "--no-report", "-q"]
    done = CliRunner().invoke(explain, words, catch_exceptions=False)
    assert done.exit_code == 0
    assert done.output.startswith(("Simulation and recordings agree", "No physics is missing"))
    assert "held at their reference: grip" in done.output
    model = yaml.safe_load((tmp_path / "out" / "model.yaml").read_text())["robot"]
    assert [joint["name"] for joint in model["joints"]] == ["shoulder", "elbow"]
    (tmp_path / "arm.xml").unlink()
    time, q, qd, qdd = motion()
    planned = {"t": time, **numbered("q", q), **numbered("qd", qd), **numbered("qdd", qdd)}
    write_table(tmp_path / "motion.parquet", planned)
    words = ["--model", "out", "--motion", "motion.parquet", "--out", "said.parquet"]
    assert CliRunner().invoke(simulate, words, catch_exceptions=False).exit_code == 0
    assert np.max(np.abs(read_table(tmp_path / "said.parquet").joints("torque") - torque)) < 0.2
