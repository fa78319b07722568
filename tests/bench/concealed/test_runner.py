"""A case from files to scores, with a product that only repeats the simulation."""

import sys
from pathlib import Path

from concealed.cases import Spec
from concealed.runner import Job, arguments, figures, judge, wanted

PRODUCT = """
import json, pathlib, sys
import numpy as np, pyarrow as pa, pyarrow.parquet as pq
option = lambda name: pathlib.Path(sys.argv[sys.argv.index(name) + 1])
if sys.argv[1] == "explain":
    answer = {"verdict": "explained", "findings": FINDINGS}
    (option("--out") / "findings.json").write_text(json.dumps(answer))
    (option("--out") / "model.yaml").write_text("{}")
else:
    motion = pq.read_table(option("--motion"))
    assert not [c for c in motion.column_names if c.startswith("tau") or c == "power"]
    n = sum(c.startswith("qdd_") for c in motion.column_names)
    zero = np.zeros(motion.num_rows)
    torque = {f"tau_{j + 1}": zero for j in range(n)}
    pq.write_table(pa.table({"t": motion["t"], **torque, "power": zero}), option("--out"))
"""


def job(small_case, tmp_path: Path, findings: list) -> Job:
    work, _ = small_case
    script = tmp_path / "product.py"
    script.write_text(PRODUCT.replace("FINDINGS", repr(findings)))
    methods = ("explain", "sparse", "network")
    return Job("x", 4, Spec("single", (), "short"), work, f"{sys.executable} {script}", methods, True)


def test_every_method_is_scored_on_one_case(small_case, tmp_path):
    key = small_case[1]
    answer = [{**key["required"][0], "kind": "missing", "parameters": {}}]
    row = judge(job(small_case, tmp_path, answer))
    assert row["explain"]["exact"]
    assert row["explain"]["error"] is None
    worse = [g for g in row["explain"]["hold_out"] if g["channel"] == "power"] or row["explain"]["hold_out"]
    assert all(g["model"] > g["simulation"] for g in worse)
    assert f"torque_offset@{key['required'][0]['joint']}" in row["sparse"]["named"]
    refitted = [g["gap_closed_refit"] for g in row["network"]["hold_out"]]
    assert refitted == [g["gap_closed_refit"] for g in row["sparse"]["hold_out"]]
    result = figures([row], ("explain", "sparse", "network"))
    assert result["cases"] == 1
    assert result["exact"] == 1.0
    assert result["failures"] == []


def test_cases_are_chosen_by_level_effect_or_name():
    specs = [Spec("null", (), "short"), Spec("single", (("payload", "weak"),), "short"), Spec("null", (), "long")]
    assert wanted(specs, [], None) == [0, 1, 2]
    assert wanted(specs, ["null"], 1) == [0]
    assert wanted(specs, ["payload", "case-003"], None) == [1, 2]


def test_command_of_the_issue_is_understood():
    a = arguments().parse_args(["--json"])
    assert (a.json, a.jobs, a.cases) == (True, 2, None)
