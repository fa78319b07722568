import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import ConfigError, ModelError
from cellwatt_plugins.faults import api
from cellwatt_plugins.faults.command import faults, reference
from tests.daemon.report.reading import check, read
from tests.docs.pages import blocks
from tests.plugins.faults.cycles.conftest import HEALTHY
from tests.plugins.faults.cycles.four_joints import Cycle, Fault, Run, describe, run, write_table
from tests.plugins.faults.watching import beside_another_arm, called


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("cell")
    describe(where)
    write_table(where / "reference.parquet", run(HEALTHY, seed=1))
    cycles = [Cycle("A"), Cycle("B", pause=1.0, faults=(Fault("spring", 0, 50.0),))]
    write_table(where / "test.parquet", run(cycles, seed=5))
    words = ("--robot", where / "robot.yaml", "--out", where / "reference.yaml")
    learned = called(reference, where / "reference.parquet", *words)
    assert learned.exit_code == 0, learned.output
    (where / "learned.txt").write_text(learned.stdout)
    return where


def judge(folder, *more):
    """Of an option that is given again, the last counts."""
    known = ["--reference", folder / "reference.yaml", "--robot", folder / "robot.yaml"]
    return called(faults, folder / "test.parquet", *known, *more)


def test_the_program_of_the_page_draws_the_reference(folder, tmp_path, monkeypatch):
    (block,) = blocks("faults.md", "python")
    (tmp_path / "references").mkdir()
    (tmp_path / "references" / "weld-3.yaml").write_text((folder / "reference.yaml").read_text())
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(block.text, block.page, "exec"), names)
    assert len(names["figure"].data) > 1 and (tmp_path / "reference.html").is_file()


def test_the_whole_cycles_learned_are_reported(folder):
    lines = (folder / "learned.txt").read_text().splitlines()
    assert [line for line in lines if line.startswith("whole cycles")] == [
        "whole cycles of task_1: 5 moves, 4 cycles at speed 1.00",
        "whole cycles of task_1: 5 moves, 2 cycles at speed 0.60",
        "whole cycles of task_2: 4 moves, 4 cycles at speed 1.00",
        "whole cycles of task_2: 4 moves, 2 cycles at speed 0.60",
    ]


def test_the_pair_of_commands(folder, tmp_path):
    result = judge(folder, "--out", tmp_path / "findings.json")
    assert result.exit_code == 0, result.output
    first, second = json.loads((tmp_path / "findings.json").read_text())["cycles"]
    assert (first["status"], second["status"]) == ("healthy", "fault")
    assert (second["task"], [(f["joint"], f["kind"]) for f in second["faults"]]) == ("task_2", [(1, "joint")])
    keys = "joint kind intervals size_watt confidence alternatives statement or_kind"
    assert " ".join(second["faults"][0]) == keys
    assert "2 cycles: 1 fault, 1 healthy" in result.output


def test_a_recording_without_a_cycle_is_named_so(folder, tmp_path):
    measured = run([Cycle("A")], seed=5)
    at_rest = Run(measured.time[:80], measured.position[:80], measured.power[:80], [])
    still = write_table(tmp_path / "still.parquet", at_rest)
    known = ("--reference", folder / "reference.yaml", "--robot", folder / "robot.yaml")
    assert called(faults, still, *known).stdout == "no cycle was judged: no task is complete in RECORDING\n"


def test_the_page_has_the_pictures_and_the_numbers_of_the_findings(folder, tmp_path):
    cycles = json.loads(judge(folder, "--json", "--report", tmp_path / "page.html").stdout)["cycles"]
    page = read(tmp_path / "page.html")
    check(page)
    assert page.headings[0] == ("h1", "1 of 2 cycles shows a fault; joint 1 is named most often, in 1 of them.")
    overview, residual = page.figures
    marks = next(trace for trace in overview["data"] if trace["name"] == "joint")
    assert (marks["x"], marks["y"]) == ([2.0], [1.0])
    assert next(t for t in overview["data"] if t["type"] == "heatmap")["x"] == [1.0, 2.0]
    limits, _, measured, explained = residual["data"]
    peaks = [max(abs(y) for y in trace["y"]) for trace in (limits, measured, explained)]
    assert peaks[2] == pytest.approx(cycles[1]["faults"][0]["size_watt"], abs=0.1)
    assert peaks[0] < peaks[2] / 3
    assert peaks[1] == pytest.approx(peaks[2], rel=0.3)
    for row, cycle in zip(page.tables["All cycles"][1:], cycles, strict=True):
        assert [float(cell) for cell in row[1:3]] == pytest.approx([cycle["start"], cycle["end"]], abs=0.006)
        assert (row[3], float(row[4]), row[5]) == (cycle["task"], cycle["speed"], cycle["status"])
    row, fault = page.tables["All cycles"][2], cycles[1]["faults"][0]
    assert (row[6], float(row[7])) == (f"{fault['statement']} paused for 1.0 s", fault["confidence"])
    assert {str(folder / name) for name in ("test.parquet", "reference.yaml")} < {r[0] for r in page.tables["Files"]}


def test_cycles_are_judged_without_a_description(folder, tmp_path):
    known = ("--reference", tmp_path / "bare.yaml")
    assert called(reference, folder / "reference.parquet", "--out", tmp_path / "bare.yaml").exit_code == 0
    first, second = json.loads(called(faults, folder / "test.parquet", *known, "--json").stdout)["cycles"]
    assert (first["status"], second["status"]) == ("healthy", "fault")
    assert [(f["joint"], f["kind"]) for f in second["faults"]] == [(1, "joint")]


def test_a_reference_learned_without_the_robot_is_refused_with_it(folder, tmp_path):
    called(reference, folder / "reference.parquet", "--out", tmp_path / "bare.yaml")
    result = judge(folder, "--reference", tmp_path / "bare.yaml")
    assert isinstance(result.exception, ModelError)
    assert "learn it again with --robot" in str(result.exception)


@pytest.mark.parametrize(
    "its, other, told", [("joint_4", "wrist", "joint_4"), ("robot: points", "robot: ur10e", "is of robot points, ")]
)
def test_another_robot_is_refused(folder, tmp_path, its, other, told):
    for name in ("robot.yaml", "robot.urdf"):
        (tmp_path / name).write_text((folder / name).read_text().replace(its, other))
    result = judge(folder, "--robot", tmp_path / "robot.yaml")
    assert isinstance(result.exception, ModelError)
    assert told in str(result.exception)


def test_a_table_that_names_the_joints_is_read_by_the_names_of_the_robot(folder, tmp_path):
    names = ("waist", "shoulder", "elbow", "wrist")
    for file in ("robot.yaml", "robot.urdf"):
        text = (folder / file).read_text()
        for number, name in enumerate(names, start=1):
            text = text.replace(f"joint_{number}", f"{name}_joint")
        (tmp_path / file).write_text(text)
    for file in ("reference.parquet", "test.parquet"):
        told = pq.read_table(folder / file)
        columns = {f"{name}_joint_position": told[f"q_{names.index(name) + 1}"] for name in sorted(names)}
        pq.write_table(pa.table({"t": told["t"], **columns, "power": told["power"]}), tmp_path / file)
    robot = tmp_path / "robot.yaml"
    api.reference(tmp_path / "reference.parquet", robot=robot).save(tmp_path / "reference.yaml")
    found = api.faults(tmp_path / "test.parquet", reference=tmp_path / "reference.yaml", robot=robot)
    assert [[fault.joint for fault in cycle.faults] for cycle in found.cycles] == [[], [1]]


def test_a_packaged_robot_is_known_by_its_name(folder, monkeypatch):
    monkeypatch.setattr("cellwatt_plugins.robot.description.PACKAGED", folder.parent)
    found = api.faults(folder / "test.parquet", reference=folder / "reference.yaml", robot=folder.name)
    assert [cycle.status for cycle in found.cycles] == ["healthy", "fault"]
    learned = api.reference(folder / "reference.parquet", robot=folder.name)
    assert (learned.reference.robot, len(learned.reference.cycles)) == ("points", 4)


def test_of_two_arms_the_one_of_the_reference_is_judged_by_a_channel_in_watts(folder, monkeypatch):
    (frames,) = api.frames_of_files([folder / "test.parquet"])
    monkeypatch.setattr(api, "frames_of_files", lambda *_: [beside_another_arm(frames)])
    known = {"reference": folder / "reference.yaml", "robot": folder / "robot.yaml"}
    assert [cycle.status for cycle in api.faults((), **known).cycles] == ["healthy", "fault"]
    with pytest.raises(ConfigError, match=r"table.joint_1.position is in rad, expected W"):
        api.faults((), **known, power="table.joint_1.position")
