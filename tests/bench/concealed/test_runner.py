"""A case from files to scores, with a product that only repeats what it is given."""

import os
import sys
from pathlib import Path

import pytest
from concealed import kept, product
from concealed.cases import Spec
from concealed.judging import Codes, Job, judge
from concealed.runner import arguments, attempted, figures, jobs_of, place, wanted

PRODUCT = """
import json, pathlib, sys
option = lambda name: pathlib.Path(sys.argv[sys.argv.index(name) + 1])
if sys.argv[1] == "explain":
    answer = {"verdict": "explained", "findings": FINDINGS}
    (option("--out") / "findings.json").write_text(json.dumps(answer))
    (option("--out") / "model.yaml").write_text("{}")
elif "--simulation" in sys.argv and not KNOWS:
    sys.exit("Error: No such option '--simulation'.")
else:
    import numpy as np, pyarrow as pa, pyarrow.parquet as pq
    motion = pq.read_table(option("--motion"))
    assert not [c for c in motion.column_names if c.startswith("tau") or c == "power"]
    if KNOWS:
        told = pq.read_table(option("--simulation"))
        pq.write_table(told, option("--out"))
    else:
        n = sum(c.startswith("q_") for c in motion.column_names)
        zero = np.zeros(motion.num_rows)
        torque = {f"tau_{j + 1}": zero for j in range(n)}
        pq.write_table(pa.table({"t": motion["t"], **torque, "power": zero}), option("--out"))
"""


def product_in(folder: Path, findings: list, knows: bool) -> str:
    """The command of a product that finds what it is told, and knows `--simulation` or not."""
    script = folder / "product.py"
    script.write_text(PRODUCT.replace("FINDINGS", repr(findings)).replace("KNOWS", repr(knows)))
    return f"{sys.executable} {script}"


def job(small_case, tmp_path: Path, findings: list, knows: bool, methods=("explain",)) -> Job:
    work, key = small_case
    command = product_in(tmp_path, findings, knows)
    codes = Codes("making", tmp_path.name, "judging")
    spec, motions = Spec("single", (), "short"), ("planned", "recorded")
    one = Job("x", 4, spec, work, command, methods, codes, motions=motions, refits=len(methods) > 1)
    kept.keep(*one.made, key | {"seconds_to_make": 1.0})
    return one


@pytest.mark.slow
def test_every_method_is_scored_on_one_case(small_case, tmp_path):
    key = small_case[1]
    answer = [{**key["required"][0], "kind": "missing", "parameters": {}}]
    row = judge(job(small_case, tmp_path, answer, False, ("explain", "sparse", "network")))
    assert row["explain"]["exact"]
    assert row["explain"]["error"] is None
    assert row["explain"]["without_simulation"]
    worse = [g for g in row["explain"]["hold_out"] if g["channel"] == "power"] or row["explain"]["hold_out"]
    assert all(g["model"] > g["simulation"] for g in worse)
    assert f"torque_offset@{key['required'][0]['joint']}" in row["sparse"]["named"]
    refitted = [g["gap_closed_refit"] for g in row["network"]["hold_out"]]
    assert refitted == [g["gap_closed_refit"] for g in row["sparse"]["hold_out"]]
    result = figures([row], ("explain", "sparse", "network"))
    assert result["cases"] == 1
    assert result["exact"] == 1.0
    assert result["failures"] == []


def test_prediction_is_given_the_simulation_of_the_sealed_motion(small_case, tmp_path):
    row = judge(job(small_case, tmp_path, [], True))
    assert not row["explain"]["without_simulation"]
    for motion in ("hold_out", "hold_out_recorded"):
        assert row["explain"][motion]
        for gap in row["explain"][motion]:
            assert gap["model"] == pytest.approx(gap["simulation"], rel=1e-3)
            assert gap["gap_closed"] == pytest.approx(0.0, abs=1e-3)


def test_cases_are_chosen_by_level_effect_simulation_or_name():
    specs = [
        Spec("null", (), "short", simulation="tool"),
        Spec("single", (("payload", "weak"),), "short"),
        Spec("null", (), "long"),
    ]
    assert wanted(specs, [], None) == [0, 1, 2]
    assert wanted(specs, ["null"], 1) == [0]
    assert wanted(specs, ["payload", "case-003"], None) == [1, 2]
    assert wanted(specs, ["own"], None) == wanted(specs, ["tool"], None) == [0]
    assert wanted(specs, ["law"], None) == [1, 2]


def test_cases_are_done_here_or_by_workers():
    words = ["--jobs 1", "", "--jobs 3", "--scheduler tcp://host:8786"]
    places = [place(arguments().parse_args(each.split())) for each in words]
    assert places == [None, "local:2", "local:3", "tcp://host:8786"]


def fails_at_the_second(one: Job) -> dict:
    if one.index == 1:
        raise ValueError("no such case")
    return {"robot": "r", "seconds_to_make": 1.0}


def test_a_case_that_the_benchmark_fails_at_is_said_and_left_out(tmp_path, capsys):
    jobs = jobs_of(arguments().parse_args(["--cases", "3"]), "x", tmp_path)
    found = attempted(fails_at_the_second, jobs)
    assert [job.name for job, _ in found] == ["case-001", "case-003"]
    assert "case-002 FAILED in the benchmark: ValueError('no such case')" in capsys.readouterr().err


def test_command_of_the_issue_is_understood(tmp_path):
    a = arguments().parse_args(["--json"])
    assert (a.json, a.jobs, a.cases) == (True, 2, None)
    a = arguments().parse_args(["--no-baselines", "--law-only"])
    jobs = jobs_of(a, "x", tmp_path)
    assert {j.methods for j in jobs} == {("explain",)}
    assert {j.spec.simulation for j in jobs} == {"law"}


def test_nothing_is_left_of_a_write_that_failed(tmp_path):
    file = tmp_path / "rows" / "case-001.json"
    kept.keep(file, "a", {"x": 1})
    with pytest.raises(TypeError):
        kept.keep(file, "b", {"x": object()})
    assert kept.read(file, "a") == {"x": 1}
    assert [p.name for p in file.parent.iterdir()] == [file.name]
    assert os.access(file, os.R_OK)
    assert product.LIMIT == 300.0
