from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.explain.input.admission import check_run
from cellwatt_plugins.explain.input.admission.motion import check_moving
from cellwatt_plugins.explain.input.admission.pairing import check_pairing
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import Plan
from tests.plugins.explain.input.reading import examine, read_runs
from tests.plugins.explain.recorded_arm import (
    EFFECTS,
    JOINTS,
    NOISE,
    excitation,
    model,
    needed,
    points,
    recorded,
    some,
    without_plan,
    write_robot,
)
from tests.plugins.robot import scara

CASES = Path(__file__).resolve().parents[4] / ".." / "shared" / "concealed" / "dev"
DEGREES = 57.29577951308232
MOTIONS = {"excitation": excitation, "points": points}
PLAN = ("position", "velocity", "acceleration")


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """A description that knows no friction and no rotors."""
    changes = {"coulomb_friction": 0.0, "viscous_friction": 0.0, "rotor_inertia": 0.0}
    return Arm.load(write_robot(tmp_path_factory.mktemp("bare"), **changes))


@pytest.fixture(scope="module")
def frictionless(bare):
    """A recording of an arm without friction, whose wrists carry little, and without noise in its torques."""
    moves, random = excitation(seed=1), np.random.default_rng(1)
    return Run(
        name="run_01",
        time=moves.time,
        position=moves.q + 1e-5 * random.standard_normal(moves.q.shape),
        velocity=moves.qd + 1e-3 * random.standard_normal(moves.q.shape),
        torque=bare.torque(moves.q, moves.qd, moves.qdd),
    )


@pytest.fixture(scope="module")
def runs(described):
    return [recorded(described, motion(seed=1)) for motion in MOTIONS.values()]


@pytest.fixture(params=range(len(MOTIONS)), ids=list(MOTIONS))
def run(request, runs):
    return runs[request.param]


def refusal(runs, arm):
    with pytest.raises(RecordingError) as caught:
        examine(runs, arm)
    message = str(caught.value)
    assert "\n" not in message
    return message


def times(factor, *names):
    """The named quantities times a factor, or one factor a joint."""

    def change(run):
        return replace(run, **{name: getattr(run, name) * factor for name in names})

    return change


def joint(number, factor, *names):
    factors = np.ones(JOINTS)
    factors[number - 1] = factor
    return times(factors, *names)


def ordered(order, *names):
    def change(run):
        return replace(run, **{name: getattr(run, name)[:, order] for name in names})

    return change


def simulated(factor, *names):
    def change(run):
        plan = replace(run.plan, **{name: getattr(run.plan, name) * factor for name in names if name in PLAN})
        told = {name: getattr(run.simulated, name) * factor for name in names if name not in PLAN}
        return replace(run, plan=plan, simulated=replace(run.simulated, plan=plan, **told))

    return change


def stuck(name, number=None):
    def change(run):
        values = getattr(run, name).copy()
        values[..., slice(None) if number is None else number - 1] = values[5, ...] if number is None else 0.25
        return replace(run, **{name: values})

    return change


def shifted(seconds):
    """The simulation later by so much."""

    def change(run):
        samples = round(seconds / run.step)
        parts = {name: np.roll(getattr(run.plan, name), samples, axis=0) for name in PLAN}
        return replace(run, plan=replace(run.plan, **parts))

    return change


MOTION = ("position", "velocity")
ALL = ("position", "velocity", "torque")
ELBOW_FIRST = [2, 1, 0, 3, 4, 5]
ELBOW_TEXT = "q_1 holds joint 3, q_3 holds joint 1"

WRONG = {
    "positions in degrees": (times(DEGREES, "position"), "57.3 times the simulated ones (degrees against radians)"),
    "simulation in degrees": (
        simulated(DEGREES, "position", "velocity", "acceleration"),
        "simulated positions of joints 1, 2, 3, 4, 5, 6 are 57.3 times the recorded ones (degrees against radians)",
    ),
    "positions of motors": (times(100.0, "position"), "times the simulated ones (the motor's angle"),
    "velocity in degrees/s": (times(DEGREES, "velocity"), "velocity of joint 1 is 57.3 times the derivative"),
    "velocity of motors in rpm": (times(3000 / np.pi, "velocity"), "it seems to be that of the motor, in rpm"),
    "torque in mNm": (times(1e3, "torque"), "times what motion and description require: it seems to be in mNm"),
    "torque of one joint in mNm": (joint(4, 1e3, "torque"), "torque of joint 4 is some thousand times too large"),
    "simulated torque in mNm": (simulated(1e3, "torque"), "its simulation's torque is 1000 times what"),
    "power in kW": (times(1e-3, "power"), "is it in kW? It must be in W"),
    "power of the other sign": (times(-1.0, "power"), "is its sign swapped?"),
    "simulated power in kW": (simulated(1e-3, "power"), "in its simulation: power is"),
    "joints in another order": (ordered(ELBOW_FIRST, *ALL), f"another order than the simulation's: {ELBOW_TEXT}"),
    "torques in another order": (ordered(ELBOW_FIRST, "torque"), "tau_1 holds joint 3, tau_3 holds joint 1"),
    "velocities in another order": (ordered(ELBOW_FIRST, "velocity"), "qd_1 holds joint 3, qd_3 holds joint 1"),
    "joint turned round": (joint(2, -1, *ALL), "positions of joint 2 have opposite signs"),
    "torque turned round": (joint(2, -1, "torque"), "torque of joint 2 has the opposite sign"),
    "velocity turned round": (joint(3, -1, "velocity"), "velocity of joint 3 has the opposite sign"),
    "position stuck": (stuck("position", 3), "q_3 stays at one value in every sample"),
    "power stuck": (stuck("power"), "in every sample although the arm moves"),
    "simulation late": (shifted(1.5), "1.50 s later than the recording: subtract 1.50 s from the simulation's times"),
    "another zero": (
        lambda run: replace(run, position=run.position + np.array([0, np.pi / 2, 0, 0, 0, 0])),
        "positions of joint 2 are 1.57 rad off the simulated ones throughout",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_input_is_said_in_one_line(case, runs, arm):
    """Every other one with each kind of motion, and without a simulation the other way round."""
    change, message = WRONG[case]
    run = runs[list(WRONG).index(case) % len(runs)]
    assert message in refusal([change(run)], arm)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (times(DEGREES, *MOTION), "are they in degrees?"),
        (ordered(ELBOW_FIRST, *ALL), f"the joints are in another order than in the robot's description: {ELBOW_TEXT}"),
        (ordered([0, 2, 1, 3, 4, 5], *MOTION), "the positions are in another order than in the robot's description"),
        (joint(2, -1, *ALL), "position and torque count in the opposite direction at joint 2"),
    ],
)
def test_without_a_simulation_the_torques_tell(change, message, run, arm):
    assert message in refusal([without_plan(change(run))], arm)


def test_small_motions_in_degrees_are_told_by_the_torques(described, arm):
    moves = excitation(seed=2)
    small = replace(moves, q=moves.q / 20, qd=moves.qd / 20, qdd=moves.qdd / 20)
    run = times(DEGREES, *MOTION)(without_plan(recorded(described, small)))
    assert "the positions are in degrees: converted to rad, the torques agree" in refusal([run], arm)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (ordered([0, 2, 1, 3, 4, 5], *ALL), "q_2 holds joint 3, q_3 holds joint 2"),
        (ordered(ELBOW_FIRST, "torque"), "tau_1 holds joint 3, tau_3 holds joint 1"),
        (joint(2, -1, "torque"), "torque of joint 2 has the opposite sign"),
    ],
)
def test_joints_are_told_though_wrists_carry_next_to_nothing(change, message, frictionless, bare):
    random = np.random.default_rng(8)
    run = replace(frictionless, torque=frictionless.torque + 0.5 * random.standard_normal(frictionless.torque.shape))
    assert examine([run], bare)[1] == ["no power recorded: effects that show only in the supply cannot be tested"]
    assert message in refusal([change(run)], bare)


def test_a_simulation_of_another_run(described, arm):
    runs = [recorded(described, excitation(seed), name=f"run_0{seed}") for seed in (1, 2, 3)]
    crossed = [replace(run, plan=plan.plan) for run, plan in zip(runs, runs[1:] + runs[:1], strict=True)]
    told = refusal(crossed, arm)
    assert "run_01: the recording does not follow its simulation (joint " in told
    assert "is it the simulation of this run?" in told


def test_zeros_of_a_linear_axis_differ_by_metres(tmp_path):
    time, q, qd, qdd = scara.motion()
    arm = Arm.load(scara.write(tmp_path))
    planned = Plan(q + np.array([0.5, 0, 0.3]), qd, qdd)
    run = Run("press", time, q, qd, scara.torque(q, qd, qdd), plan=planned)
    with pytest.raises(RecordingError, match=r"joints 1, 3 are -0.50 rad, -0.30 m off the simulated"):
        check_pairing(run, arm.description)


def test_too_short(described, arm):
    assert "250 usable samples in 2.50 s are too few: at least 3 s and 75 samples" in refusal(
        [recorded(described, excitation(1, seconds=2.5))], arm
    )
    assert "60 usable samples in 6.00 s" in refusal([recorded(described, excitation(1, seconds=6, rate=10))], arm)
    gappy = recorded(described, excitation(1, seconds=5))
    assert "200 usable samples in 2.00 s" in refusal([replace(gappy, gaps=gappy.time >= 2.0)], arm)


def at_rest(described):
    return recorded(described, some(excitation(1)), name="rest")


def test_nothing_moves(described, arm):
    rest = at_rest(described)
    assert "rest: nothing moves (at most 0.000" in refusal([rest], arm)
    with pytest.raises(RecordingError, match="rest: nothing moves"):
        check_run(rest, arm)


@pytest.mark.parametrize(("axis", "travel", "unit"), [(0, 0.008, "rad"), (2, 0.0016, "m")])
def test_an_axis_is_at_rest_by_its_own_unit(axis, travel, unit, tmp_path):
    """A press of 40 mm moves, and so does a joint of 40 mrad."""
    press = Arm.load(scara.write(tmp_path))
    t = np.arange(1000) * 0.02

    def moved(stroke):
        position = np.outer(stroke / 2 * np.sin(3 * t), np.eye(3)[axis])
        return Run("press", t, position, None, np.outer(np.cos(3 * t), np.full(3, 100.0)))

    check_moving([moved(0.04)], press)
    with pytest.raises(RecordingError, match=rf"nothing moves \(at most {travel:.4f} {unit} at a joint"):
        check_moving([moved(travel)], press)


def test_a_recording_of_small_motions_is_compared_with_others(described, arm):
    moves = excitation(1)
    small = replace(moves, **{name: getattr(moves, name) / 80 for name in ("q", "qd", "qdd")})
    run = recorded(described, small)
    assert 0.01 < np.ptp(run.position, axis=0).max() < 0.05
    assert check_run(run, arm).position.shape == run.position.shape


def test_a_motion_without_its_torque_shows_nothing(described, arm):
    run = recorded(described, some(excitation(1), 1))
    torque = np.where(np.arange(JOINTS) == 0, np.nan, run.torque)
    assert "run_01: nothing moves (at most 0.000" in refusal([replace(run, torque=torque)], arm)


SHORT = [(excitation, 3, "gain", 0.0, 1.2), (points, 1, "gain", 3.8, 1.2), (excitation, 1, "ceiling", 0.0, 3.0)]


@pytest.mark.parametrize(("motion", "seed", "effect", "start", "seconds"), SHORT)
def test_along_one_way_torques_show_neither_order_nor_sign(motion, seed, effect, start, seconds, described, arm):
    run = without_plan(recorded(described, motion(seed), effect=EFFECTS[effect], seed=7))
    rows = (run.time >= start) & (run.time < start + seconds)
    columns = {name: getattr(run, name)[rows] for name in ("time", *ALL, "power")}
    assert examine([recorded(described, excitation(5)), replace(run, name="short", **columns)], arm)[1] == []


def test_a_run_at_rest_among_others_is_a_note(described, arm):
    assert examine([at_rest(described), recorded(described, excitation(1))], arm)[1] == ["rest: the arm stands still"]


def test_rounding_of_a_simulated_torque_is_in_no_order(described, arm):
    moves = excitation(1)
    run = recorded(described, some(replace(moves, q=moves.q - moves.q[0]), 6))
    torque = run.simulated.torque.copy()
    torque[:, 0] = 1e-16 * np.random.default_rng(3).standard_normal(len(torque))
    simulated = replace(run.simulated, torque=torque)
    (note,) = examine([replace(run, simulated=simulated)], arm)[1]
    assert note == "joints 1, 2, 3, 4, 5 never moved: friction and inertia there cannot be found"


@pytest.mark.parametrize(("motion", "seed"), [(excitation, 1), (excitation, 4), (points, 1), (points, 5)])
def test_gravity_of_an_arm_on_the_ceiling_is_no_sign(motion, seed, described, arm, bare):
    """With little friction other signs explain gravity's torques, too, but not as well as another mount."""

    def hung(moves, torque, path):
        return needed(model(path, gravity=(0, 0, 9.81)), moves, friction=0.05)

    assert isinstance(examine([without_plan(recorded(described, motion(seed), effect=hung))], bare)[1], list)
    right = without_plan(recorded(described, motion(seed)))
    for number in (2, 3, 5):
        turned = joint(number, -1, "torque")(right)
        assert f"torque of joint {number} has the opposite sign" in refusal([turned], arm)


@pytest.mark.parametrize("effect", EFFECTS)
def test_what_a_robot_may_do_is_no_wrong_input(effect, described, arm, bare):
    """Every other effect with each kind of motion."""
    motion = list(MOTIONS.values())[list(EFFECTS).index(effect) % len(MOTIONS)]
    run = recorded(described, motion(seed=4), effect=EFFECTS[effect], seed=7)
    for kept in (run, replace(without_plan(run), velocity=None)):
        assert examine([kept], arm)[1] == []
    assert all("differs from the simulation" in note for note in examine([run], bare)[1])


def tracked(run, seconds, error):
    late = np.column_stack([np.interp(run.time - seconds, run.time, one) for one in run.position.T])
    return replace(run, position=late + error, velocity=None)


@pytest.mark.parametrize(("seconds", "error"), [(0.1, -0.05), (0.0, 2 * np.pi)])
def test_loose_tracking_is_no_wrong_input(seconds, error, run, arm):
    assert examine([tracked(run, seconds, error)], arm)[1] == []


def test_late_tracking_is_a_note(described, arm):
    run = recorded(described, excitation(1))
    (note,) = examine([tracked(run, 0.2, 0.0)], arm)[1]
    assert note == "run_01: the recorded motion comes 0.20 s after the simulation's"


def test_a_leap_that_is_no_whole_turn_is_refused_with_its_place(run, arm):
    position = run.position.copy()
    position[700:, 3] += 4.0
    torn = replace(without_plan(run), position=position, velocity=None)
    assert (
        f"q_4 jumps by {abs(np.diff(position[699:701, 3])[0]):.2f} rad at t = {run.time[700]:.3f} s (sample 701)"
        in (refusal([torn], arm))
    )


def test_a_multi_turn_joint_is_no_wrong_unit(described, arm):
    moves = excitation(1)
    screw = 2.0 * moves.time
    turning = replace(moves, q=np.column_stack([moves.q[:, :5], screw]), qd=moves.qd.copy(), qdd=moves.qdd.copy())
    turning.qd[:, 5], turning.qdd[:, 5] = 2.0, 0.0
    assert examine([recorded(described, turning)], arm)[1] == []


def test_other_supplies_are_no_wrong_unit(run, arm):
    joints = np.sum(run.torque * run.plan.velocity, axis=1)
    for power in (
        2000 + joints / 0.6,
        0.5 + np.maximum(joints, 0),
        np.convolve(run.power, np.ones(300) / 300, "same"),
        np.full(len(joints), 90.0) + 0.1 * np.sin(run.time),
    ):
        assert examine([replace(run, power=power)], arm)[1] == []


def test_cut_off_and_coarse_torques_are_notes(described, arm):
    run = recorded(described, excitation(1))
    limit = 0.7 * run.torque[:, 1].max()
    cut = replace(run, torque=np.clip(run.torque, None, [1e9, limit, 1e9, 1e9, 1e9, 1e9]))
    (note,) = examine([cut], arm)[1]
    assert f"the torque of joint 2 stays at its extreme of {limit:.4g} Nm in" in note
    steps = 20 * NOISE[2]
    torque = run.torque.copy()
    torque[:, 2] = np.round(torque[:, 2] / steps) * steps
    (note,) = examine([replace(run, torque=torque)], arm)[1]
    assert note == f"run_01: the torque of joint 3 comes in steps of {steps:.3g} Nm: smaller effects cannot be found"


def concealed():
    """Every tenth case by default, all of them among the slow tests."""
    cases = sorted(CASES.iterdir()) if CASES.is_dir() else []
    return [pytest.param(case, marks=[pytest.mark.slow] if i % 10 else []) for i, case in enumerate(cases)]


@pytest.mark.parametrize("case", concealed(), ids=lambda case: case.name)
def test_concealed_cases_are_admitted_without_a_word(case):
    arm = Arm.load(case)
    seen, said = sorted(case.glob("*.recording.parquet")), sorted(case.glob("*.simulation.parquet"))
    runs = read_runs(seen, said, arm.description)
    assert len(runs) == len(seen)
    assert examine(runs, arm)[1] == []
    assert examine([without_plan(run) for run in runs], arm)[1] == []


def test_a_wrist_that_carries_nothing_is_in_no_other_unit(described, arm):
    """Its friction and load are below what friction may be; only the description has a tool there."""
    run = recorded(described, excitation(1))
    noise = np.random.default_rng(2).normal(0, 1e-3, len(run.time))
    idle = np.column_stack([run.torque[:, :-1], noise])
    assert isinstance(examine([replace(run, torque=idle)], arm)[1], list)
