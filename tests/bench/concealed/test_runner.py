"""A case from files to scores, with a product that only repeats what it is given; a run that is killed and goes on."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from concealed import kept, product
from concealed.cases import Spec
from concealed.judging import Codes, Job, judge, make
from concealed.runner import arguments, attempted, figures, jobs_of, place, wanted

PRODUCT = """
import json, os, pathlib, signal, sys
option = lambda name: pathlib.Path(sys.argv[sys.argv.index(name) + 1])
if sys.argv[1] == "explain":
    here = pathlib.Path(__file__).parent
    with (here / "calls").open("a") as calls:
        calls.write(option("--out").name + "\\n")
    if (here / "kill").exists() and len((here / "calls").read_text().split()) == 2:
        (here / "kill").unlink()
        for pid in {os.getppid(), int((here / "pid").read_text())}:
            os.kill(pid, signal.SIGKILL)
        sys.exit(1)
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


@pytest.mark.slow
def test_what_is_kept_is_not_done_again_unless_code_or_seed_is_another(small_case, tmp_path):
    one = job(small_case, tmp_path, [], True)
    first, calls = judge(one), tmp_path / "calls"
    assert judge(one) == first
    assert calls.read_text().split() == ["case-005"]
    rescored = replace(one, codes=replace(one.codes, judging="other"))
    assert judge(rescored)["explain"]["named"] == first["explain"]["named"]
    assert calls.read_text().split() == ["case-005"]
    assert kept.read(*replace(one, codes=replace(one.codes, product="other")).answered) is None
    assert kept.read(*replace(one, seed="z").made) is None
    assert make(one)["id"] == "case-005"


SMALL_RUN = """
import os, pathlib, sys
sys.path[:0] = [BENCH]
from concealed import setting
small = setting.RunSet((("excite", 4), ("task", 4)), (("excite", 4),), (100,), 0.001, 0.004)
for name in setting.RUN_SETS:
    setting.RUN_SETS[name] = small
from concealed.runner import main
if __name__ == "__main__":
    pathlib.Path(HERE, "pid").write_text(str(os.getpid()))
    main()
"""


def small_run(bench: Path, folder: Path, work: Path, jobs: int = 1) -> subprocess.CompletedProcess:
    """The benchmark over two short nulls as a process of its own, with a product that finds a torque offset."""
    script = folder / "run.py"
    script.write_text(SMALL_RUN.replace("BENCH", repr(str(bench))).replace("HERE", repr(str(folder))))
    command = product_in(folder, [{"effect": "torque_offset", "joint": 1, "kind": "missing"}], True)
    words = [sys.executable, str(script), "--json", "--only", "null", "--cases", "2", "--jobs", str(jobs)]
    words += ["--no-baselines", "--work", str(work), "--command", command]
    return subprocess.run(words, capture_output=True, text=True, check=False)


def without_times(result: str) -> dict:
    """The figures without how long they took."""
    found = json.loads(result)
    for of in (found["methods"]["explain"], *found["methods"]["explain"]["by_simulation"].values()):
        del of["seconds_median"], of["seconds_max"]
    for of in found["methods"]["explain"]["by_kind"].values():
        del of["seconds_median"], of["seconds_max"]
    return found


@pytest.mark.slow
def test_a_run_that_was_killed_goes_on_to_the_figures_of_two_workers(bench, tmp_path, monkeypatch):
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))  # who is killed leaves its own behind
    (tmp_path / "kill").touch()
    stopped = small_run(bench, tmp_path, tmp_path / "work")
    assert stopped.returncode == -signal.SIGKILL
    assert len(list((tmp_path / "work" / "rows").glob("case-*.json"))) == 1
    resumed = small_run(bench, tmp_path, tmp_path / "work")
    assert "1 of 2 cases are kept from before" in resumed.stderr
    calls = (tmp_path / "calls").read_text().split()
    assert len(calls) == 3
    assert calls[1] == calls[2]
    for folder in ("made", "dev", "keys"):
        shutil.copytree(tmp_path / "work" / folder, tmp_path / "other" / folder)
    whole = small_run(bench, tmp_path, tmp_path / "other", jobs=2)
    assert without_times(resumed.stdout) == without_times(whole.stdout)
    assert json.loads(resumed.stdout)["methods"]["explain"]["null_false_rate"]["hits"] == 2
    (tmp_path / "more").mkdir()
    other = small_run(bench, tmp_path / "more", tmp_path / "work")
    assert other.returncode != 0
    assert "2 answers" in other.stderr


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
