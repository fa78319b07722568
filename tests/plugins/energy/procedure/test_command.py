import json

import pytest
from click.testing import CliRunner

from cellwatt.errors import ConfigError
from cellwatt_plugins.energy.procedure.command import campaign
from tests.plugins.energy.procedure.recording import Taped


def run(*words):
    return CliRunner().invoke(campaign, [str(word) for word in words], catch_exceptions=False)


def test_programs_are_written(tmp_path):
    done = run("programs", "UR5e", "--out", tmp_path, "--speeds", "100,200", "--json")
    told = json.loads(done.stdout)
    assert [path.split("/")[-1] for path in told["files"]] == ["UR5e_0kg.script", "UR5e_5kg.script"]
    assert "speeds = [0.1, 0.2]" in (tmp_path / "UR5e_5kg.script").read_text()
    # 1.931 m at 100 and 200 mm/s, a second of rest each, ten a speed.
    assert told["minutes_each"] == pytest.approx((30 * (19.31 + 9.66 + 2) + 20) / 60, abs=0.1)


@pytest.mark.parametrize(("speeds", "said"), [("fast", "expected numbers"), ("100,-5", "above 0")])
def test_speeds_that_are_none(tmp_path, speeds, said):
    done = run("programs", "UR5e", "--out", tmp_path, "--speeds", speeds)
    assert done.exit_code == 2
    assert said in done.output


def test_the_rest_pose_is_told(plant, tmp_path):
    file = plant.describe(tmp_path)
    told = json.loads(run("rest-pose", "--robot", file, "--starts", "4", "--json").stdout)
    assert told["residual"] < 1.0
    assert len(told["joints"]) == 6
    assert "gravity leaves" in run("rest-pose", "--robot", file, "--starts", "1").output


def test_files_are_cut_by_the_log(plant, programme, tmp_path):
    file = plant.describe(tmp_path / "robot")
    (tmp_path / "record").mkdir()
    taped = Taped(tmp_path / "record", plant)
    taped.state("connected", 81.4)
    taped.programme(0.0, *programme)
    taped.write()
    log = tmp_path / "campaign.json"
    log.write_text(taped.log.model_dump_json())
    words = ["cut", tmp_path / "record", "--robot", file, "--campaign", log, "--out", tmp_path / "cut"]
    words += ["--speeds", "200,250", "--repetitions", "30"]
    told = json.loads(run(*words, "--json").stdout)
    assert told["states"] == ["connected"]
    assert [(r["run"], r["repetitions"], r["written"]) for r in told["runs"]] == [
        ("200_0kg", 3, False),
        ("250_0kg", 3, False),
    ]
    assert "3 of 30 repetitions, too few" in run(*words).output
    told = json.loads(run(*words, "--least", "3", "--json").stdout)
    assert all(one["written"] for one in told["runs"])
    assert len(list((tmp_path / "cut" / "runs").iterdir())) == 4


def test_a_cell_that_does_not_record_cannot_be_measured(plant, tmp_path):
    file = plant.describe(tmp_path / "robot")
    cell = tmp_path / "cell.yaml"
    text = "site: s\ncell: c\nsources:\n  supply: {driver: scpi_analyzer, host: 192.0.2.11}\n"
    cell.write_text(f"{text}zenoh: {{listen: [tcp/127.0.0.1:7447]}}\n")
    with pytest.raises(ConfigError, match="the cell does not record: add record"):
        run("measure", cell, "--robot", file, "--out", tmp_path / "out")


def test_a_robot_without_a_payload_is_asked_for_it(plant, tmp_path):
    file = plant.describe(tmp_path / "robot")
    file.write_text("\n".join(line for line in file.read_text().splitlines() if not line.startswith("payload")))
    with pytest.raises(ConfigError, match="payload: write the maximum payload's mass"):
        run("measure", file, "--robot", file, "--out", tmp_path / "out")
