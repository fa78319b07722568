import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from cellwatt.commands import EXIT_ERROR, EXIT_USAGE
from cellwatt.errors import RecordingError
from cellwatt_plugins.explain import api
from cellwatt_plugins.explain.command import explain
from cellwatt_plugins.explain.model import load_model
from tests.plugins.explain import plant
from tests.plugins.explain.calling import call
from tests.plugins.explain.logs import numbered, parquet


def files(cell, kind):
    return [cell / f"run_0{number}.{kind}.parquet" for number in (1, 2)]


@pytest.fixture(scope="module")
def explained(cell, tmp_path_factory):
    """What ``explain`` leaves in its folder."""
    out = tmp_path_factory.mktemp("explained") / "results"
    words = ["--simulation", *files(cell, "simulation"), "--robot", cell / "robot.yaml", "--out", out]
    assert call("explain", *files(cell, "recording"), *words)[0] == 0
    return out


def test_findings_model_and_report_are_written(explained):
    found = json.loads((explained / "findings.json").read_text())
    assert found["verdict"] == "explained"
    assert [(f["effect"], f["joint"]) for f in found["findings"]] == [("torque_offset", 3)]
    assert found["findings"][0]["parameters"]["offset"]["value"] == pytest.approx(1.5, abs=0.2)
    assert [f["channel"] for f in found["fit"]] == ["tau_1", "tau_2", "tau_3", "power"]
    start, offset, retuned = found["cascade"]
    gain = found["findings"][0]["improvement"]
    assert [start["kind"], offset["effect"], retuned["kind"]] == ["simulation", "torque_offset", "retuning"]
    assert gain["before"] == pytest.approx(start["channels"]["tau_3"], rel=1e-3)
    assert gain["after"] == offset["channels"]["tau_3"]
    assert retuned["channels"] == pytest.approx({f["channel"]: f["model"] for f in found["fit"]})
    assert (explained / "model.yaml").exists()
    page = (explained / "report.html").read_text()
    assert "<html" in page
    assert 'src="http' not in page


def test_in_words_each_finding_is_a_sentence(cell, tmp_path):
    words = ["--simulation", *files(cell, "simulation"), "--robot", cell, "--out", tmp_path, "--no-report"]
    code, said, _ = call("explain", *files(cell, "recording"), *words)
    assert code == 0
    assert said.startswith("The difference is explained: torque offset (joint 3).")
    assert "joint 3" in said.lower()
    assert "held-out error" in said
    assert (
        said.index("Your simulation") < said.index("+ torque offset of joint 3") < said.index("+ your numbers retuned")
    )
    assert str(tmp_path) in said


def test_without_a_simulation_the_robot_is_simulated(cell, tmp_path):
    words = ["--robot", cell, "--out", tmp_path, "--json", "--no-report"]
    code, said, _ = call("explain", *files(cell, "recording"), *words)
    assert code == 0
    assert ("torque_offset", 3) in {(f["effect"], f["joint"]) for f in json.loads(said)["findings"]}


def motion_columns():
    time = np.arange(500) / plant.RATE
    q, qd, qdd = plant.moves(9, 5.0)(time)
    return {"t": time, **numbered("q", q), **numbered("qd", qd), **numbered("qdd", qdd)}, (time, q, qd, qdd)


def test_simulate_says_what_the_model_says(explained, tmp_path):
    columns, motion = motion_columns()
    source = parquet(tmp_path / "motion.parquet", columns)
    code, _, errors = call(
        "simulate", "--model", explained / "model.yaml", "--motion", source, "--out", tmp_path / "deep" / "said.parquet"
    )
    assert (code, errors) == (0, "")
    table = pq.read_table(tmp_path / "deep" / "said.parquet")
    assert table.column_names == ["t", "tau_1", "tau_2", "tau_3", "power"]
    expected = plant.predict(load_model(explained), *motion)
    assert np.allclose(table["t"], motion[0])
    assert np.allclose(table["power"], expected.power)
    for i in range(plant.JOINTS):
        assert np.allclose(table[f"tau_{i + 1}"], expected.torque[:, i])


def one_line(*words):
    code, said, errors = call(*words)
    assert said == ""
    assert "Traceback" not in errors
    assert len(errors.strip().splitlines()) == 1
    return code, errors


def test_a_bad_recording_is_one_line_and_an_error(cell, tmp_path):
    folder = shutil.copytree(cell, tmp_path / "cell")
    path = folder / "run_01.recording.parquet"
    table = pq.read_table(path)
    parquet(path, {n: np.degrees(table[n]) if n.startswith("q_") else table[n] for n in table.column_names})
    simulation = folder / "run_01.simulation.parquet"
    code, errors = one_line("explain", path, "--simulation", simulation, "--robot", folder, "--out", tmp_path / "out")
    assert code == EXIT_ERROR
    assert "deg" in errors
    assert "run_01" in errors
    assert not (tmp_path / "out").exists()


def test_a_list_without_recordings_is_refused(cell):
    with pytest.raises(RecordingError, match="no recording given"):
        api.explain([], robot=cell)


def test_an_option_without_its_file_is_no_comparison_with_the_robot(cell, tmp_path):
    first = cell / "run_01.recording.parquet"
    code, said, errors = call("explain", first, "--simulation", "--robot", cell, "--out", tmp_path)
    assert (code, said) == (EXIT_USAGE, "")
    assert "Option '--simulation' requires an argument." in errors


@pytest.mark.parametrize("at", [0, 1])
def test_recordings_may_follow_a_simulators_file(cell, tmp_path, at):
    simulator = tmp_path / "arm.urdf"
    simulator.touch()
    words = [*files(cell, "recording"), "--out", tmp_path]
    words[at:at] = ["--simulation", simulator]
    given = explain.make_context("explain", [str(word) for word in words]).params
    assert (given["recordings"], given["simulations"]) == (tuple(files(cell, "recording")), (simulator,))


def test_recordings_behind_tables_of_simulations_are_told_from_none(cell, tmp_path):
    words = ["--simulation", *files(cell, "simulation"), *files(cell, "recording"), "--out", tmp_path]
    code, _, errors = call("explain", *words)
    assert code == EXIT_USAGE
    assert "Give the recordings before --simulation" in errors


def test_simulate_refuses_what_is_no_model(cell, tmp_path):
    source = parquet(tmp_path / "m.parquet", motion_columns()[0])
    words = ["simulate", "--model", cell / "robot.yaml", "--motion", source, "--out", tmp_path / "p.parquet"]
    code, errors = one_line(*words)
    assert code == EXIT_USAGE
    assert "models are written by `cellwatt explain`" in errors
