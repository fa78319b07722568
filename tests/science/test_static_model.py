"""The hybrid static model: the paper's equations and methods, and what the best model is worth beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwatt.arrays import rows_of
from cellwatt_plugins.models.static import paper
from cellwatt_plugins.models.static.identify import HeldArm, identify
from cellwatt_plugins.models.static.poses import read_poses
from cellwatt_plugins.models.static.training import PUBLISHED, Scores
from cellwatt_plugins.robot import Arm
from tests.plugins.models.static import arms

SHARED = Path(__file__).resolve().parents[2] / ".." / "shared" / "static_poses"


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """An arm that has what its CAD model has not: other masses, a spring, friction. Gravity explains 0.89 of it."""
    folder = tmp_path_factory.mktemp("case")
    really = arms.Arm(
        mass=arms.MASS * np.array([1, 1.05, 1.1, 1.1, 1.1, 1]),
        spring=np.array([0, 0, 20.0, 0, 0, 0]),
        relaxed=np.full(6, 0.15),
        friction=0.01 * arms.RATED,
        load_friction=0.03,
    )
    robot, unseen = arms.write_case(folder, really, 5)
    described = Arm.load(robot)
    poses = read_poses([folder / "samples.parquet"], described.description)
    return described, poses, unseen


def test_gravity_is_equation_2():
    """τ_i = Σ m_j g ∂p_j/∂q_i, p_j the height of a link's centre of mass, by differences."""
    body = Arm.load("mh12").body
    arm = arms.Arm(mass=np.array([*arms.MASS[:5], 0.0]), centre=_paper_centres())
    q = arms.within(arms.LIMITS, arms.halton(20))

    def energy(q):
        rotation, origin = arm.frames(q)
        heights = [(origin[:, i] + rotation[:, i] @ arm.centre[i])[:, 2] for i in range(6)]
        return 9.81 * np.sum(arm.mass * np.stack(heights, axis=1), axis=1)

    steps = 1e-6 * np.eye(6)
    by_difference = np.stack([(energy(q + step) - energy(q - step)) / 2e-6 for step in steps], axis=1)
    np.testing.assert_allclose(body.gravity(q), by_difference, atol=1e-5)


def _paper_centres():
    """Table I; link 4 from its far end, 0.32 m out."""
    table = [[0.035, 0.005, -0.188], [-0.018, -0.092, 0.258], [0.089, -0.034, 0.12], [-0.224, 0, 0.017]]
    centres = np.array([*table, [0.026, -0.015, 0], [0, 0, 0]])
    centres[3, 0] += 0.32
    return centres


def test_published_accuracy_is_100_less_mape():
    """Table III: 84.217, 83.329 and 95.729 %."""
    for method, accuracy in (("gravity", 84.217), ("network", 83.329), ("hybrid", 95.729)):
        assert 100 - PUBLISHED[method][2] == pytest.approx(accuracy)


@pytest.fixture(scope="module")
def by_method(collected):
    """RMSE, R² and MAPE on the fifth left out; neurons as the paper found them, 216 and 475."""
    described, poses, _ = collected
    gravity = described.gravity(poses.q)
    simulated = np.abs(gravity).sum(axis=1)
    both = np.hstack([poses.q, gravity])
    rows, test = paper.split(len(poses))
    plain = paper.trained(poses.q[rows], poses.total[rows], 216)
    residual = paper.trained(both[rows], poses.total[rows] - simulated[rows], 475)
    printed = paper.trained(both[rows], poses.total[rows], 475)
    said = {
        "gravity": simulated,
        "network": plain(poses.q),
        "hybrid": simulated + residual(both),
        "hybrid as printed": printed(both),
    }
    return {name: Scores.of(poses.total[test], value[test]) for name, value in said.items()}


def test_the_methods_keep_the_papers_order(by_method):
    """Table III: RMSE 13.19 < 29.31 < 30.19 Nm, and MAPE; by either reading of the hybrid's output."""
    for hybrid in ("hybrid", "hybrid as printed"):
        for what in ("rmse", "mape"):
            best, *others = (getattr(by_method[name], what) for name in (hybrid, "gravity", "network"))
            assert best < 0.8 * min(others), (hybrid, what)
    assert by_method["gravity"].rmse < by_method["network"].rmse
    assert by_method["hybrid"].rmse < by_method["hybrid as printed"].rmse


def test_the_hybrid_gains_as_much_as_in_the_paper(by_method):
    """RMSE "by a factor of 2.22" (29.31 / 13.19); gravity and network alike (30.19 / 29.31 = 1.03); R² 0.936."""
    rmse = {name: scores.rmse for name, scores in by_method.items()}
    assert rmse["gravity"] / rmse["hybrid"] == pytest.approx(29.31 / 13.19, rel=0.2)
    assert rmse["network"] / rmse["gravity"] == pytest.approx(30.19 / 29.31, rel=0.15)
    assert by_method["hybrid"].r2 > PUBLISHED["hybrid"][1]


def test_the_hybrids_mape_is_near_the_papers_and_gravitys_is_not(by_method):
    """4.271 %; from 15.783 % by a factor of 3.7, here from 10.6 % by 2.3: the arm is nearer to its CAD model."""
    assert by_method["hybrid"].mape == pytest.approx(PUBLISHED["hybrid"][2], abs=1.0)
    assert by_method["gravity"].mape == pytest.approx(10.6, abs=1.0)
    assert by_method["gravity"].mape < PUBLISHED["gravity"][2]


def test_table_iii_is_of_one_set_of_poses():
    """RMSE² / (1 - R²) is the variance of what was measured: 52 Nm squared by each method, to the digits printed."""
    spreads = [rmse / np.sqrt(1 - r2) for rmse, r2, _ in PUBLISHED.values()]
    assert spreads == pytest.approx([52.2] * 3, abs=0.3)


def test_the_papers_n_is_not_its_fifth():
    """80/20 of 532 leaves 106 out, "132 in this case" are 24.8 %; either can be asked for."""
    for share, left_out in ((paper.TEST, 106), (132 / 532, 132)):
        rows, test = paper.split(532, share)
        assert (len(rows), len(test)) == (532 - left_out, left_out)
        assert sorted([*rows, *test]) == list(range(532))


def test_mape_as_printed_is_no_percentage(by_method):
    """Eq. 6 lacks the division: a hundred times the mean error in Nm, which "accuracy" (eq. 7) would make negative."""
    assert all(100 - 100 * scores.mean_absolute < 0 for scores in by_method.values())


def r2(described, poses, new, total):
    arm = HeldArm.of(described, poses.q)
    model = identify(arm.basis(poses), poses.torque, arm.effects(poses))
    said = model.total(arm.basis(replace(poses, **new)))
    return float(1 - np.mean((said - total) ** 2) / np.var(total))


@pytest.mark.skipif(not SHARED.exists(), reason="the recordings are not beside this checkout")
def test_on_the_shared_recording_poses_left_out_are_predicted():
    described = Arm.load(SHARED / "robot.yaml")
    poses = read_poses([SHARED / "samples.parquet"], described.description)
    rows, test = paper.split(len(poses))
    new = {"q": poses.q[test], "approach": poses.approach[test], "payload": poses.payload[test]}
    assert r2(described, rows_of(poses, rows), new, poses.total[test]) > 0.998
