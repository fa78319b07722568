"""The plant against figures that it did not make."""

import numpy as np
import pytest
from concealed.arms import draw_arm
from concealed.describe import urdf
from concealed.families import FAMILIES
from concealed.law import GRAVITY, RigidBody, gravity_of, joint_torque
from concealed.mechanics import Dahl, Joints, Moment, Push
from concealed.motion import STYLES, excite
from concealed.plant import Body, Grip, Run, TwoMass, simulate, tune

from tests.bench.independent import assert_shares_no_code


def arm_of(family: str = "compact6", seed: int = 3):
    return draw_arm(np.random.default_rng(seed), family)


def test_shares_no_code_with_the_product(bench):
    assert_shares_no_code(bench / "concealed")


@pytest.mark.parametrize("family", FAMILIES)
def test_urdf_and_plant_are_one_arm(family, tmp_path):
    pin = pytest.importorskip("pinocchio")
    arm = arm_of(family)
    (tmp_path / "robot.urdf").write_text(urdf(arm))
    model = pin.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 5, arm.joints))
    expected = [pin.rnea(model, model.createData(), q[i], v[i], a[i]) for i in range(5)]
    assert np.allclose(RigidBody(arm).torque(q, v, a), expected, rtol=1e-6, atol=1e-6)


def test_a_mass_in_the_hand_weighs_what_it_weighs():
    arm = arm_of()
    still = np.zeros((1, arm.joints))
    com = np.array([0.1, 0.0, 0.05])
    more = RigidBody(arm, (2.0, com)).torque(still, still, still) - RigidBody(arm).torque(still, still, still)
    ahead = (arm.origins[2:].sum(axis=0) + arm.flange + com)[0]
    assert more[0, 1] == pytest.approx(-2.0 * GRAVITY * ahead)
    assert more[0, 0] == pytest.approx(0.0, abs=1e-9)


def test_gravity_of_a_tilted_base_keeps_its_size_and_leans_the_other_way():
    g = gravity_of(0.0, 0.1)
    assert np.linalg.norm(g) == pytest.approx(GRAVITY)
    assert g[0] == pytest.approx(GRAVITY * np.sin(0.1))


@pytest.mark.parametrize("style", STYLES)
def test_motions_stay_within_reach_and_their_derivatives_fit(style):
    arm, rng = arm_of(), np.random.default_rng(1)
    plan = STYLES[style](rng, arm, 30.0, [2])
    assert (plan.q > arm.low - 0.05).all()
    assert (plan.q < arm.high + 0.05).all()
    assert np.allclose(np.cumsum(plan.v, axis=0) * plan.tick, plan.q - plan.q[0], atol=5e-3)
    assert np.abs(plan.v[0]).max() < 1e-5
    assert np.abs(plan.v[:, 2]).max() > 0.1


def test_motor_torque_is_the_law_of_the_motion():
    arm, rng = arm_of(), np.random.default_rng(2)
    body = Body(arm, Joints.of(arm))
    trace = simulate(body, [excite(rng, arm, 6.0, [])], tune(rng, body, 0.001))
    q, v, a, torque = (np.asarray(x[:, 0], float) for x in (trace.q, trace.v, trace.a, trace.torque))
    away = np.abs(v) > 0.05
    off = np.where(away, torque - joint_torque(arm, q, v, a), 0.0)
    assert np.abs(off).max() < 0.02 * np.abs(torque).max()
    assert (np.sqrt(np.mean(off**2, axis=0)) / arm.noise).max() < 0.05


def test_friction_takes_motion_under_a_soft_loop_off_its_plan():
    arm = arm_of()
    body = Body(arm, Joints.of(arm))
    plan = excite(np.random.default_rng(2), arm, 4.0, [])
    off = []
    for hertz in (None, 9.0):
        trace = simulate(body, [plan], tune(np.random.default_rng(2), body, 0.001, hertz))
        planned = np.stack([np.interp(trace.t, np.arange(len(plan.q)) * plan.tick, q) for q in plan.q.T], axis=1)
        moving = (trace.t > 0) & (trace.t < 3.9)
        off.append(np.std((trace.q[:, 0] - planned)[moving], axis=0))
    assert (off[1] > 1.3 * off[0]).all()
    assert off[1].max() < 0.001


def test_a_spring_in_the_gear_gives_way_by_torque_over_stiffness():
    arm = arm_of()
    body = Body(arm, Joints.of(arm), two_mass=TwoMass(1, 2e4, 80.0))
    rng = np.random.default_rng(4)
    control = tune(rng, body, 0.001)
    run = Run(body, 1, 0.001)
    q = np.tile(0.5 * (arm.low + arm.high), (3000, 1, 1))
    trace = run.follow(q, 0.0 * q, np.zeros_like(q), control)
    assert run.data.qpos[run.gears[0]] == pytest.approx(-trace.torque[-1, 0, 1] / 2e4, rel=1e-2)


def test_a_grip_comes_and_goes():
    grip = Grip(1.0, np.zeros(3), start=2.0, hold=3.0, period=10.0)
    assert [grip.held(t) for t in (1.9, 2.1, 4.9, 5.1, 12.1)] == [False, True, True, False, True]
    assert Grip(1.0, np.zeros(3)).held(0.0)


def moment(q: float, t: float = 0.0) -> Moment:
    one = np.full((1, 1), q)
    return Moment(t, 0.001, one, one, np.sign(one), one, one)


def test_dahl_friction_follows_the_exponential_after_a_reversal():
    term = Dahl(0, 2.0, 0.01)
    for q in (0.0, 1.0, 1.0 - 0.005):
        torque = np.zeros((1, 1))
        term.add(moment(q), torque)
    assert torque[0, 0] == pytest.approx(2.0 * (-1.0 + 2.0 * np.exp(-0.5)))


def test_a_push_loads_the_motor_at_its_middle_and_is_over_after_its_width():
    term = Push(0, 0, 5.0, 0.4, 3.0)
    for t, expected in ((5.0, 3.0), (4.7, 0.0), (5.3, 0.0)):
        torque = np.zeros((1, 1))
        term.add(moment(0.0, t), torque)
        assert torque[0, 0] == pytest.approx(expected)
