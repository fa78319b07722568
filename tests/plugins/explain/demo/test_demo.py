"""``cellwatt demo explain``: the arm has what was concealed, and a wrong answer is said to be wrong."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from cellwatt.commands import cli
from cellwatt_plugins.explain.demo.arm import JOINTS, believed, draw, mjcf
from cellwatt_plugins.explain.demo.physics import Concealed, conceal, kinds
from cellwatt_plugins.explain.demo.plant import run
from cellwatt_plugins.explain.demo.reveal import compared
from cellwatt_plugins.robot.effects import BY_NAME
from cellwatt_plugins.robot.motion import Plan

pytest.importorskip("mujoco")
LEANING = np.array([0.0, 1.2, 0.0, 0.0])
"""rad: the arm is straight, and the shoulder carries all of it."""
CREEP = 0.3
"""rad/s of the joint that is looked at."""


def torque(tmp_path, kind: str | None, moving: int | None = None) -> tuple[np.ndarray, list[Concealed]]:
    """Mean torque (n,) of an arm that leans, one joint moving slowly, and what it conceals."""
    rng = np.random.default_rng(3)
    arm = draw(rng)
    (tmp_path / "arm.xml").write_text(mjcf(believed(arm, rng)))
    concealed = [] if kind is None else conceal([kind], rng, arm)
    t = np.arange(600) * 0.001
    q, qd = np.tile(LEANING, (len(t), 1)), np.zeros((len(t), JOINTS))
    if moving is not None:
        q[:, moving] += CREEP * (t - t[-1])
        qd[:, moving] = CREEP
    log = run(arm, tmp_path / "arm.xml", concealed, Plan(q, qd, np.zeros_like(q)), np.random.default_rng(4))
    return log.torque[100:].mean(axis=0), concealed


def test_a_concealed_payload_weighs_on_the_shoulder(tmp_path) -> None:
    (without, _), (loaded, [payload]) = torque(tmp_path, None, 1), torque(tmp_path, "payload", 1)
    reach = (0.5 + 0.4 + payload.hidden["reach"]) * np.sin(LEANING[1] - 0.25 * CREEP)
    weight = payload.numbers["mass"][0] * 9.81 * reach
    assert without[1] - loaded[1] == pytest.approx(weight, rel=0.05)
    assert abs(loaded[0] - without[0]) < 0.5


def test_concealed_friction_is_felt_by_the_motor(tmp_path) -> None:
    [concealed] = torque(tmp_path, "friction")[1]
    joint = concealed.joint
    plain, rubbing = torque(tmp_path, None, joint)[0], torque(tmp_path, "friction", joint)[0]
    assert rubbing[joint] - plain[joint] == pytest.approx(concealed.hidden["more"], rel=0.1)


@pytest.mark.parametrize("kind", kinds())
def test_each_kind_has_the_name_that_explain_has_for_it(kind: str) -> None:
    rng = np.random.default_rng(1)
    [concealed] = conceal([kind], rng, draw(rng))
    assert concealed.effect in BY_NAME


def finding(effect: str, joint: int | None, value: float, std: float, was: float | None = None) -> dict[str, object]:
    parameters = {"off": {"value": value, "std": std, "unit": "N*m"}}
    return {"effect": effect, "joint": joint, "parameters": parameters, "was": was, "statement": f"{effect} …"}


def test_an_answer_is_right_where_all_is_named_and_nothing_else() -> None:
    truth = [Concealed("friction", "coulomb_friction", 1, {"now": (9.0, "N*m")}, "Joint 2 …")]
    named = finding("coulomb_friction", 2, 4.0, 0.1, was=5.0)
    assert compared(truth, {"findings": [named], "retuned": []}).right
    assert compared(truth, {"findings": [named], "retuned": []}).exact
    assert not compared(truth, {"findings": [finding("coulomb_friction", 2, 3.6, 0.1, was=5.0)], "retuned": []}).exact
    moved = {"parameter": "coulomb_friction", "joint": 2, "was": 5.0, "now": 9.0, "std": 0.1, "beyond": True}
    assert compared(truth, {"findings": [], "retuned": [moved]}).right
    assert not compared(truth, {"findings": [], "retuned": [{**moved, "beyond": False}]}).right
    assert not compared(truth, {"findings": [finding("coulomb_friction", 3, 4.0, 0.1)], "retuned": []}).right
    invented = compared([], {"findings": [named], "retuned": []})
    assert not invented.right
    assert invented.invented == (named,)
    assert compared([], {"findings": [], "retuned": []}).right


@pytest.mark.slow
def test_it_finds_what_it_concealed(tmp_path) -> None:
    words = ["demo", "explain", "--conceal", "payload", "--seed", "7", "--out", str(tmp_path), "--json"]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.output
    [answer] = json.loads(done.stdout)["answers"]
    found = answer["finding"]["parameters"]["mass"]
    assert found["value"] == pytest.approx(answer["concealed"]["numbers"]["mass"][0], abs=4 * found["std"])
    assert {path.name for path in tmp_path.iterdir()} >= {"arm.xml", "run_1.csv", "run_2.csv", "result"}
