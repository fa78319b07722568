"""What held poses say of arms whose truth is known."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.models.static import exported
from cellwatt_plugins.models.static import identify as identify_module
from cellwatt_plugins.models.static.findings import findings
from cellwatt_plugins.models.static.identify import HeldArm, Identified, identify, identify_checked
from cellwatt_plugins.models.static.poses import Poses
from cellwatt_plugins.models.static.training import train
from cellwatt_plugins.robot import Arm
from tests.plugins.models.static import arms


def collection(arm: arms.Arm, seed: int, count: int) -> Poses:
    """A collection in the order of the sequence; each pose's mean as a controller in whole per cent gives it."""
    rng = np.random.default_rng(seed)
    table = arms.samples(arm, rng, count)
    percent = np.stack([table[f"torque_percent_{j}"] for j in range(1, 7)], axis=1).reshape(count, 100, 6)
    q = arms.within(arm.limits, arms.halton(count))
    approach = np.vstack([np.full((1, 6), np.nan), np.diff(q, axis=0)])
    return Poses(q, percent.mean(axis=1) / 100 * arm.rated, approach, np.full(count, np.nan))


def known(folder, poses: Poses, cad: arms.Arm | None = None) -> HeldArm:
    return HeldArm.of(Arm.load(arms.write_robot(folder, cad or arms.Arm())), poses.q)


def fitted(folder, really: arms.Arm, count: int, stated: float = 1.0) -> tuple[Identified, HeldArm, Poses]:
    """An arm identified by somebody who states ranges that are ``stated`` times those of the poses."""
    poses = collection(really, 1, count)
    arm = known(folder, poses, arms.Arm(limits=stated * really.limits, rated=really.rated))
    return identify(arm.basis(poses), poses.torque, arm.effects(poses)), arm, poses


def r2(model: Identified, arm: HeldArm, really: arms.Arm, seed: int = 9) -> float:
    q, came, torque = arms.unseen(really, np.random.default_rng(seed), 200)
    poses = Poses(q, np.zeros_like(q), q - came, np.full(200, np.nan))
    total = np.abs(torque).sum(axis=1)
    return float(1 - np.mean((model.total(arm.basis(poses)) - total) ** 2) / np.var(total))


@pytest.mark.parametrize(
    ("seed", "count", "least", "stated"), [(3, 40, 0.995, 1.0), (3, 40, 0.999, 6.0), (8, 300, 0.998, 1.0)]
)
def test_arms_drawn_at_random_are_found(tmp_path, seed, count, least, stated):
    really = arms.some_arm(seed)
    model, arm, _ = fitted(tmp_path, really, count, stated)
    assert r2(model, arm, really) > least


def test_an_arm_like_its_cad_model_is_left_alone(tmp_path):
    really = arms.Arm(friction=0.01 * arms.RATED)
    model, arm, poses = fitted(tmp_path, really, 200)
    told = findings(model, arm, arm.basis(poses))
    assert {finding.kind for finding in told} <= {"friction", "gravity"}
    assert sum(finding.kind == "gravity" for finding in told) <= 1  # twenty to one is not never


def test_findings_are_true_within_their_deviations(tmp_path):
    really = arms.Arm(
        friction=np.array([2.0, 5, 4, 1, 1, 0.5]),
        load_friction=0.04,
        spring=np.array([0, 0, 25.0, 0, 0, 0]),
        relaxed=np.full(6, -0.2),
        tool=(3.0, (0.1, 0.0, 0.0)),
    )
    model, arm, poses = fitted(tmp_path, really, 300)
    told = findings(model, arm, arm.basis(poses))
    friction = {f.joints[0]: f.figures[0] for f in told if f.kind == "friction"}
    for joint, true in enumerate(really.friction, start=1):
        assert abs(friction[joint].value - true) < 3.5 * friction[joint].deviation
    (stiffness, *_), *others = [f.figures for f in told if f.kind == "spring"]
    assert not others
    assert abs(stiffness.value - 25.0) < 3.5 * stiffness.deviation
    (share,) = [f.figures for f in told if f.kind == "load friction"]
    two = next(figure for figure in share if figure.name == "joint 2")
    assert abs(two.value - 4.0) < 3.5 * two.deviation
    assert any("Joint 2 carries" in f.statement and "in the CAD model" in f.statement for f in told)


class Bumpy(arms.Arm):
    """Something no physics here has: a bump over three joints."""

    def load(self, q):
        bump = np.exp(-np.sum((q[:, [0, 3, 4]] - [0.3, 0.5, -0.2]) ** 2, axis=1))
        return super().load(q) + 20.0 * bump[:, None] * np.array([0, 1, 1, 0.1, 0.1, 0])


def test_what_physics_leaves_is_learned_only_where_it_helps(tmp_path, monkeypatch):
    monkeypatch.setattr(identify_module, "FOLDS", 3)
    plain = arms.Arm(friction=0.01 * arms.RATED)
    for really, helps in ((plain, False), (Bumpy(friction=0.01 * arms.RATED), True)):
        poses = collection(really, 1, 100)
        arm = known(tmp_path, poses)
        basis, effects = arm.basis(poses), arm.effects(poses)
        checked = identify_checked(poses, basis, effects)
        assert (checked.model.leftover is not None) == helps
        if helps:
            fuller = r2(checked.model, arm, really)
            assert fuller > r2(replace(checked.model, leftover=None), arm, really)


@pytest.mark.parametrize("joint", [1, 5])
def test_a_torque_of_the_opposite_sign_is_refused(tmp_path, monkeypatch, joint):
    monkeypatch.setattr(identify_module, "FOLDS", 2)
    poses = collection(arms.Arm(friction=0.01 * arms.RATED), 1, 40)
    poses = replace(poses, torque=poses.torque * np.where(np.arange(6) == joint, -1, 1))
    with pytest.raises(RecordingError, match=f"torque of joint_{joint + 1} has the opposite sign"):
        train(poses, known(tmp_path, poses))


def test_an_arm_on_a_wall_that_leans_is_not_level(tmp_path):
    poses = collection(arms.Arm(), 1, 60)
    robot = arms.write_robot(tmp_path, arms.Arm())
    robot.write_text(robot.read_text() + "gravity: [9.81, 0, 0]\n")
    arm = HeldArm.of(Arm.load(robot), poses.q)
    field = 9.81 * np.array([np.cos(0.02), 0.0, np.sin(0.02)])
    noise = 0.001 * arms.RATED * np.random.default_rng(2).normal(size=poses.q.shape)
    held = np.nan_to_num(np.sign(poses.approach)) * 0.01 * arms.RATED
    poses = replace(poses, torque=arm.arm.body.with_gravity(field).gravity(poses.q) + held + noise)
    model = identify(arm.basis(poses), poses.torque, arm.effects(poses))
    told = {finding.kind: finding.statement for finding in findings(model, arm, arm.basis(poses))}
    assert re.match("The base is not level: down along z 1.1[0-9]* ± ", told["tilt"])
    assert not {"spring", "hose", "gain", "zero"} & told.keys()
    assert exported._identified(model, arm)[1] == pytest.approx(field, abs=0.02)


def test_payloads_between_poses_are_told_apart_from_the_arm(tmp_path):
    carried = np.array([0.0, 3.0, 8.0])[np.arange(160) % 3]
    parts = [collection(arms.Arm(tool=(mass, (0.12, 0.0, 0.03)), hold=0.0005), 1, 160) for mass in (0.0, 3.0, 8.0)]
    torque = np.choose((np.arange(160) % 3)[:, None], [part.torque for part in parts])
    poses = replace(parts[0], torque=torque, payload=carried)
    arm = known(tmp_path, poses)
    model = identify(arm.basis(poses), poses.torque, arm.effects(poses))
    centre = model.posterior.mean[model.effects.slices["payload"]]
    np.testing.assert_allclose(centre, [0.12, 0.0, 0.03], atol=0.01)
