"""What a seed stands for, and a small case from draw to files."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from concealed.cases import generator, kind_of, specs
from concealed.effects import KINDS, UNKNOWNS
from concealed.files import load_run
from concealed.seal import commit, reveal

from tests.effect_names import CONTRACT


def test_every_effect_of_the_table_is_drawn_at_each_strength():
    assert set(KINDS) == set(CONTRACT.replace("*", "").split())
    drawn = {e for s in specs("x") if s.level == "single" for e in s.effects}
    assert drawn == {(name, level) for name in KINDS for level in ("weak", "medium", "strong")}


def test_enough_cases_nulls_and_unknowns():
    levels = [s.level for s in specs("x")]
    assert len(levels) >= 200
    assert levels.count("null") >= 60
    assert levels.count("unknown") >= 20
    assert {e for s in specs("x") if s.level == "unknown" for e, _ in s.effects} == set(UNKNOWNS)


def test_a_seed_says_everything():
    assert specs("x") == specs("x")
    assert specs("x") != specs("y")
    assert generator("x", "case", 1).random() != generator("x", "case", 2).random()


def test_pairs_need_one_set_of_recordings():
    for s in specs("x"):
        wanted = {kind_of(e).run_set for e, _ in s.effects} - {"short"}
        assert len(wanted) < 2
        assert not wanted or s.run_set in wanted


def test_seed_is_committed_before_and_revealed_after(tmp_path):
    secret, promise = tmp_path / "seed.json", tmp_path / "commitment.json"
    digest = commit(secret, promise)
    assert json.loads(promise.read_text())["sha256"] == digest
    seed, _, kept = reveal(secret, promise)
    assert kept
    assert seed not in promise.read_text()
    other = json.loads(secret.read_text()) | {"seed": "another"}
    secret.write_text(json.dumps(other))
    assert not reveal(secret, promise)[2]
    with pytest.raises(FileExistsError):
        commit(secret, promise)


def test_files_are_what_the_contract_says(small_case):
    work, key = small_case
    case, keys = work / "dev" / "case-005", work / "keys" / "case-005"
    robot = yaml.safe_load((case / "robot.yaml").read_text())
    n = len(robot["joints"])
    assert set(robot["joints"][0]) == {"name", "gear_ratio", "torque_constant", "rotor_inertia", "coulomb_friction",
                                       "viscous_friction", "winding_resistance"}  # fmt: skip
    seen = pq.read_table(case / "run_01.recording.parquet").column_names
    assert seen == ["t", *(f"{c}_{j + 1}" for c in ("q", "qd", "tau") for j in range(n)), "power"]
    told = pq.read_table(case / "run_01.simulation.parquet").column_names
    assert told == ["t", *(f"{c}_{j + 1}" for c in ("q", "qd", "qdd", "tau") for j in range(n)), "power"]
    assert sorted(p.name for p in keys.iterdir()) == [
        "holdout_03.recording.parquet",
        "holdout_03.simulation.parquet",
        "key.json",
    ]
    assert [r["split"] for r in key["runs"]] == ["open", "open", "sealed"]


def test_the_effect_is_in_the_recording_beside_the_noise_that_the_key_tells(small_case):
    work, key = small_case
    case, entry = work / "dev" / "case-005", key["effects"][0]
    joint, noise = entry["joint"], np.array(key["runs"][0]["noise"])
    assert key["required"] == [{"effect": "torque_offset", "joint": joint + 1}]
    runs = [load_run(file, work / "keys" / "case-005") for file in case.glob("*.recording.parquet")]
    left = np.concatenate([run.measured - run.simulated for run in runs])
    assert np.mean(left[:, joint]) == pytest.approx(entry["offset"], rel=0.3)
    assert key["runs"][0]["effect_rms"][joint] == pytest.approx(abs(entry["offset"]), rel=0.1)
    second = np.median(np.abs(np.diff(left, n=2, axis=0)), axis=0) / 0.6745 / np.sqrt(6.0)
    assert np.allclose(second / noise, 1.0, atol=0.2)
