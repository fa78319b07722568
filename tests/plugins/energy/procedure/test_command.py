import json

from click.testing import CliRunner

from cellwatt_plugins.energy.procedure.command import campaign
from tests.plugins.energy.procedure.recording import Taped


def run(*words):
    return CliRunner().invoke(campaign, [str(word) for word in words], catch_exceptions=False)


def test_the_rest_pose_is_told(plant, tmp_path):
    file = plant.describe(tmp_path)
    told = json.loads(run("rest-pose", "--robot", file, "--starts", "4", "--json").stdout)
    assert told["residual"] < 1.0
    assert len(told["joints"]) == 6
    assert "gravity torque" in run("rest-pose", "--robot", file, "--starts", "1").output


def test_files_are_cut_from_recordings(plant, programme, tmp_path):
    file = plant.describe(tmp_path / "robot")
    (tmp_path / "record").mkdir()
    taped = Taped(tmp_path / "record", plant)
    taped.programme(0.0, *programme)
    taped.write()
    words = ["cut", tmp_path / "record", "--robot", file, "--out", tmp_path / "cut"]
    runs = [*words, "--payload", "0", "--speeds", "200,250", "--repetitions", "30"]
    told = json.loads(run(*runs, "--json").stdout)
    assert [(r["run"], r["repetitions"], r["written"]) for r in told] == [("200_0kg", 3, False), ("250_0kg", 3, False)]
    assert "3 of 30 repetitions, too few" in run(*runs).output
    told = json.loads(run(*runs, "--least", "3", "--json").stdout)
    assert all(one["written"] for one in told)
    assert len(list((tmp_path / "cut" / "runs").iterdir())) == 4
    done = run(*words, "--state", "released")  # of an arm that moves
    assert done.output.startswith("released: ") and "find it" in done.output
    assert (tmp_path / "cut" / "released.parquet").exists()
    assert "expected either --state or --payload" in run(*words).output
