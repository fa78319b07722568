import json
import shutil

import pytest
from click.testing import CliRunner

from cellwatt.errors import RecordingError
from cellwatt_plugins.energy import api
from cellwatt_plugins.energy.command import disaggregate
from tests.calling import called
from tests.plugins.energy.running import STATES


def words(folder, out, *more, states=STATES):
    states = [word for state in states for word in (f"--{state}", str(folder / f"{state}.parquet"))]
    return ["--robot", str(folder / "robot.yaml"), *states, "--runs", str(folder / "runs"), "--out", str(out), *more]


@pytest.fixture(scope="module")
def written(measured, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    return out, called(disaggregate, *words(measured[1], out))


def test_energy_json_keeps_the_contract(written, measured):
    found = json.loads((written[0] / "energy.json").read_text())
    fixed = found["fixed"]
    for name, value in measured[2]["fixed"].items():
        assert fixed[name] == pytest.approx(value, abs=0.2)
        assert 0 < fixed[f"{name}_uncertainty"] < 0.2
    assert {run["run"] for run in found["runs"]} == {run["run"] for run in measured[2]["runs"]}
    for run in found["runs"]:
        assert run["repetitions"] == 3
        assert run["total"] > run["electronics"] > 0
        assert set(run["uncertainty"]) >= {"total", "mechanical_losses", "regeneration", "positive_mechanical"}
    assert set(found["payload_efficiency_percent"]) == {"150", "400", "1400"}


def fails(folder, tmp_path, **which):
    with pytest.raises(RecordingError) as caught:
        called(disaggregate, *words(folder, tmp_path / "out", **which))
    return str(caught.value)


@pytest.fixture
def copy(measured, tmp_path):
    folder = tmp_path / "campaign"
    shutil.copytree(measured[1], folder)
    return folder


def test_files_that_are_no_pair_are_named(copy, tmp_path):
    twin = copy / "runs" / "150_0kg.robot.csv"
    twin.touch()
    assert "the same run as 150_0kg.robot.csv: keep" in fails(copy, tmp_path)
    twin.unlink()
    (copy / "runs" / "150_0kg.analyzer.parquet").unlink()
    assert "150_0kg.analyzer.parquet is not in the same folder" in fails(copy, tmp_path)


def test_a_controller_that_was_not_measured(copy, tmp_path):
    measured = STATES[1:]
    assert "controller_separate: false" in fails(copy, tmp_path, states=measured)
    text = (copy / "robot.yaml").read_text().replace("controller_separate: true", "controller_separate: false")
    (copy / "robot.yaml").write_text(text)
    for path in (copy / "runs").glob("150_*"):
        path.unlink()  # two speeds say as much of this
    found = json.loads(called(disaggregate, *words(copy, tmp_path / "out", "--json", states=measured)))
    assert found["fixed"]["robot_electronics"] == 0
    assert found == json.loads((tmp_path / "out" / "energy.json").read_text())
    assert (tmp_path / "out" / "report.html").exists()


def test_a_file_of_the_controller_that_is_not_there_is_no_controller_that_was_not_measured(copy, tmp_path):
    """Also of an arm that cannot be unplugged, whose connected power would be taken in its place."""
    text = (copy / "robot.yaml").read_text().replace("controller_separate: true", "controller_separate: false")
    (copy / "robot.yaml").write_text(text)
    (copy / "controller.parquet").unlink()
    done = CliRunner().invoke(disaggregate, words(copy, tmp_path / "out"))
    assert done.exit_code == 2
    assert "controller.parquet' does not exist" in done.output
    states = {state: copy / f"{state}.parquet" for state in STATES}
    with pytest.raises(RecordingError, match=r"controller\.parquet"):
        api.disaggregate(robot=copy, runs=copy / "runs", **states)
