"""A case from files to scores, with a product that only repeats what it is given."""

import os
import sys
from pathlib import Path

import pytest
from concealed import kept, product
from concealed.cases import Spec
from concealed.judging import Codes, Job, judge
from concealed.runner import arguments, attempted, figures, jobs_of, wanted

PRODUCT = """
import json, pathlib, sys
option = lambda name: pathlib.Path(sys.argv[sys.argv.index(name) + 1])
if sys.argv[1] == "explain":
    answer = {"verdict": "explained", "findings": FINDINGS}
    (option("--out") / "findings.json").write_text(json.dumps(answer))
    (option("--out") / "model.yaml").write_text("{}")
else:
    import pyarrow.parquet as pq
    motion = pq.read_table(option("--motion"))
    assert not [c for c in motion.column_names if c.startswith("tau") or c == "power"]
    pq.write_table(pq.read_table(option("--simulation")), option("--out"))
"""


def job(small_case, tmp_path: Path, findings: list) -> Job:
    work, key = small_case
    script = tmp_path / "product.py"
    script.write_text(PRODUCT.replace("FINDINGS", repr(findings)))
    command = f"{sys.executable} {script}"
    codes = Codes("making", tmp_path.name, "judging")
    spec, motions = Spec("single", (), "short"), ("planned", "recorded")
    one = Job("x", 4, spec, work, command, codes, motions=motions)
    kept.keep(*one.made, key | {"seconds_to_make": 1.0})
    return one


def test_a_case_is_scored_with_the_prediction_of_its_sealed_motion(small_case, tmp_path):
    row = judge(job(small_case, tmp_path, [{**small_case[1]["required"][0], "kind": "missing", "parameters": {}}]))
    assert row["exact"]
    for motion in ("hold_out", "hold_out_recorded"):
        assert row[motion]
        for gap in row[motion]:
            assert gap["model"] == pytest.approx(gap["simulation"], rel=1e-3)
            assert gap["gap_closed"] == pytest.approx(0.0, abs=1e-3)
    result = figures([row])
    assert (result["cases"], result["exact"], result["failures"]) == (1, 1.0, [])


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


def fails_at_the_second(one: Job) -> dict:
    if one.index == 1:
        raise ValueError("no such case")
    return {"robot": "r", "seconds_to_make": 1.0}


def test_a_case_that_the_benchmark_fails_at_is_said_and_left_out(tmp_path, capsys):
    jobs = jobs_of(arguments().parse_args(["--cases", "3"]), "x", tmp_path)
    found = attempted(fails_at_the_second, jobs)
    assert [job.name for job, _ in found] == ["case-001", "case-003"]
    assert "case-002 FAILED in the benchmark: ValueError('no such case')" in capsys.readouterr().err


def test_nothing_is_left_of_a_write_that_failed(tmp_path):
    file = tmp_path / "rows" / "case-001.json"
    kept.keep(file, "a", {"x": 1})
    with pytest.raises(TypeError):
        kept.keep(file, "b", {"x": object()})
    assert kept.read(file, "a") == {"x": 1}
    assert [p.name for p in file.parent.iterdir()] == [file.name]
    assert os.access(file, os.R_OK)
    assert product.LIMIT == 300.0
