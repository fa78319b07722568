"""What real arms and their recordings have that made-up ones lack: each kind alone, in recordings of the plant."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwatt_plugins.explain.explain import Explained
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.input.unread import without_unread
from cellwatt_plugins.explain.model import load_model, save_model
from cellwatt_plugins.robot import Arm
from tests.plugins.explain import plant
from tests.plugins.explain.calling import explained
from tests.plugins.explain.input.reading import examine, read_runs
from tests.plugins.explain.logs import measured, off_before, parquet
from tests.plugins.explain.plant import REAL, Course, Missing, column, loaded, turned
from tests.plugins.robot import scara

OFFSET = Missing(read=lambda torque: torque + np.array([1.5, 0, 0]))


def recorded(missing: Missing, seconds: float = 16.0, seeds: tuple[int, ...] = (1, 2), plan: bool = True) -> list[Run]:
    return [plant.record(f"run_{s:02d}", s, missing, seconds, plan=plan, power=False) for s in seeds]


def named(found: Explained) -> set[tuple[str, int | None]]:
    return {(f.effect, f.joint) for f in found.findings.findings}


def foretells_an_unseen_motion(found: Explained, missing: Missing, folder: Path) -> None:
    save_model(found.model, folder / "model.yaml")
    time = np.arange(1000) / plant.RATE
    q, qd, qdd = plant.moves(77, 10.0)(time)
    real = plant.motors(REAL, q, qd, qdd) + missing.added(time, q, qd, "run_09")
    said = plant.predict(load_model(folder), time, q, qd, qdd).torque
    assert np.all(np.std(said - real, axis=0) < [0.5, 0.6, 0.4])


def pulled(gravity: tuple[float, float, float]) -> Callable[[np.ndarray], np.ndarray]:
    """Torque (N, 3) that holds the plant's links in a field of ``gravity`` m/s², by the slopes of their heights."""
    (m2, m3), (c2, c3) = REAL.masses, REAL.centres
    g = np.array(gravity)

    def torque(q: np.ndarray) -> np.ndarray:
        yaw, a, b = q[:, 0], q[:, 1], q[:, 1] + q[:, 2]
        out = np.zeros_like(q)
        for angle, moment, joints in ((a, m2 * c2 + m3 * REAL.length, [1]), (b, m3 * c3, [1, 2])):
            across = np.column_stack([-np.cos(angle) * np.sin(yaw), np.cos(angle) * np.cos(yaw), 0 * yaw])
            down = np.column_stack([-np.sin(angle) * np.cos(yaw), -np.sin(angle) * np.sin(yaw), -np.cos(angle)])
            out[:, 0] -= moment * across @ g
            out[:, joints] -= (moment * down @ g)[:, None]
        return out

    return torque


SIDEWAYS = (9.78, -0.6, -0.5)
AT_WALL, ON_FLOOR = pulled(SIDEWAYS), pulled((0.0, 0.0, -plant.G))
HANGING = Missing(added=lambda t, q, qd, run: AT_WALL(q) - ON_FLOOR(q))


def test_an_arm_that_hangs_sideways_lacks_nothing_but_its_mount(arm, tmp_path):
    found = explained(arm, recorded(HANGING))
    assert named(found) == {("gravity_tilt", None)}
    (mount,) = found.findings.findings
    for axis, value in zip("xyz", SIDEWAYS, strict=True):
        assert mount.parameters[f"gravity_{axis}"].value == pytest.approx(value, abs=0.4)
    assert mount.improvement.after < 0.2 * mount.improvement.before
    # What is written for other programs says it, too, of a motion that nobody recorded.
    foretells_an_unseen_motion(found, HANGING, tmp_path)


def test_a_torque_that_was_not_read_names_nothing(arm):
    runs = [replace(run, torque=run.torque.copy()) for run in recorded(OFFSET)]
    for run in runs:
        run.torque[:, 2] = 0.31
    found = explained(arm, [without_unread(run) for run in runs])
    assert named(found) == {("torque_offset", 1)}
    assert [fit.channel for fit in found.findings.fit] == ["tau_1", "tau_2"]


def test_torque_that_was_filled_in_neither_confirms_nor_refuses(arm):
    runs = []
    for run in recorded(OFFSET):
        lost = (run.time > 6.0) & (run.time < 7.5)
        runs.append(replace(run, torque=run.torque - np.outer(lost, [40.0, 0, 0]), gaps=lost))
    assert named(explained(arm, runs)) == {("torque_offset", 1)}


def held(course: Course, joint: int, at: float) -> Course:
    """The course with one joint (0-based) at rest."""

    def still(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q, qd, qdd = (part.copy() for part in course(time))
        q[:, joint], qd[:, joint], qdd[:, joint] = at, 0.0, 0.0
        return q, qd, qdd

    return still


def test_a_joint_at_rest_names_nothing(arm):
    """At rest friction holds what it is asked to: here 2 Nm more than the links."""

    missing = replace(OFFSET, added=lambda time, q, qd, run: column(np.full(len(time), 2.0), 3))
    along = [held(plant.moves(seed, 16.0), 2, 0.7) for seed in (1, 2)]
    runs = [plant.record(f"run_0{i}", i, missing, 16.0, power=False, along=a) for i, a in enumerate(along, 1)]
    found = explained(arm, runs)
    assert named(found) == {("torque_offset", 1)}
    assert "tau_3" not in [fit.channel for fit in found.findings.fit]


def test_a_joint_at_rest_takes_no_sample_from_the_supply(tmp_path):
    """Its torque is not known, and its speed flickers; it draws next to nothing."""
    unpowered = plant.load(plant.write_robot(tmp_path, standby_power=0.0))
    along = [held(plant.moves(seed, 8.0), 2, 0.7) for seed in (1, 2)]
    runs = [plant.record(f"run_0{i}", i, Missing(), 8.0, plan=False, along=a) for i, a in enumerate(along, 1)]
    found = explained(unpowered, runs)
    assert found.supply is not None
    assert np.mean(found.supply.problem.design.root) > 0.5 / plant.POWER_NOISE
    (standby,) = [f for f in found.findings.findings if f.effect == "standby_power"]
    assert standby.parameters["power"].value == pytest.approx(plant.REAL.standby, abs=1.0)


def chirp(time):
    return 5 * np.sin(2 * np.pi * (0.5 * time + 0.06 * time**2))


def test_an_offset_is_found_beside_strong_physics_that_no_law_explains(arm):
    missing = Missing(
        added=lambda time, q, qd, run: column(chirp(time), 1), read=lambda torque: torque + np.array([4.0, 0, 0])
    )
    found = explained(arm, recorded(missing))
    assert named(found) == {("torque_offset", 1), ("unknown", 1)}
    (offset,) = [f for f in found.findings.findings if f.effect == "torque_offset"]
    assert offset.parameters["offset"].value == pytest.approx(4.0, abs=0.6)


def test_the_mean_of_what_no_law_explains_is_no_offset(arm):
    pushes = Missing(added=lambda time, q, qd, run: column(np.maximum(chirp(time), 0.0), 1))
    assert named(explained(arm, recorded(pushes))) == {("unknown", 1)}


def driven_through(turns: np.ndarray) -> Missing:
    """Motors that turn by ``turns`` (3, 3) per turn of each joint, in place of one at each joint."""

    def added(time: np.ndarray, q: np.ndarray, qd: np.ndarray, run: str) -> np.ndarray:
        def motors(speed: np.ndarray) -> np.ndarray:
            gain = np.gradient(speed, time, axis=0)
            return REAL.coulomb * turned(speed) + REAL.viscous * speed + REAL.rotor * gain

        return motors(qd @ turns.T) @ turns - motors(qd)

    return Missing(added=added)


@pytest.mark.parametrize(
    ("wrist", "says"),
    [
        ([[1, 0], [1, 1]], "the motor of joint 3 turns by the sum"),
        ([[1, -1], [0, 1]], "the motor of joint 2 turns by the difference"),
        ([[1, -0.6], [0, 1]], "the motor of joint 2 turns by the angle of its joint and -0.60 times that of joint 3"),
        ([[1, 1], [-1, 1]], "their motors turn by the sum and the difference"),
    ],
)
def test_motors_that_turn_with_two_joints(arm, tmp_path, wrist, says):
    turns = np.eye(3)
    turns[1:, 1:] = wrist
    missing = driven_through(turns)
    found = explained(arm, recorded(missing))
    assert named(found) == {("joint_coupling", 3)}
    (coupling,) = found.findings.findings
    assert says in coupling.statement
    foretells_an_unseen_motion(found, missing, tmp_path)


@pytest.mark.slow
def test_friction_that_turns_over_slowly(arm):
    """That of joint 1, 5.3 Nm, and 6 Nm more, builds up over 0.1 rad/s."""

    def slow(time, q, qd, run):
        friction = REAL.coulomb[0]
        return column((friction + 6.0) * np.tanh(qd[:, 0] / 0.1) - friction * turned(qd[:, 0]), 1)

    found = explained(arm, recorded(Missing(added=slow)))
    names = named(found)
    assert ("presliding_hysteresis", 1) in names
    assert names <= {("presliding_hysteresis", 1), ("coulomb_friction", 1)}
    (finding,) = [f for f in found.findings.findings if f.effect == "presliding_hysteresis"]
    assert finding.parameters["velocity"].value == pytest.approx(0.1, rel=0.15)
    assert finding.parameters["force"].value == pytest.approx(11.3, rel=0.1)


def test_short_moves_of_an_arm_as_described_name_nothing(arm):
    assert named(explained(arm, recorded(plant.NOTHING, 3.5, (1, 2, 3, 4, 5)))) == set()


def every(run: Run, n: int) -> Run:
    """The run as a slow log has it."""
    columns = {name: getattr(run, name)[::n] for name in ("time", "position", "velocity", "torque")}
    return replace(run, **columns)


def slower(course: Course, times: float) -> Course:
    """The course so many times slower."""

    def slow(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q, qd, qdd = course(time / times)
        return q, qd / times, qdd / times**2

    return slow


@pytest.mark.slow
def test_the_mass_of_a_payload_from_a_slow_log(arm):
    """Of a motion as slow as such a log can follow."""
    carried, seconds, hertz, times = Missing(arm=loaded(REAL, 2.0, 0.12)), 100.0, 3.0, 3.0
    courses = {i: slower(plant.moves(i, seconds / times), times) for i in (1, 2)}
    runs = [plant.record(f"run_0{i}", i, carried, seconds, False, power=False, along=courses[i]) for i in courses]
    found = explained(arm, [every(run, round(plant.RATE / hertz)) for run in runs])
    assert named(found) == {("payload", None)}
    assert found.findings.findings[0].parameters["mass"].value == pytest.approx(2.0, rel=0.02)


@pytest.mark.slow
def test_friction_of_which_nothing_is_known_is_found_at_every_joint_behind_a_balancer(tmp_path):
    """Until the balancer of joint 2 is known, which takes ten times as much, no friction shows there."""

    balancer = Missing(added=lambda time, q, qd, run: column(90.0 * (q[:, 1] - 0.3), 2))
    unknown = plant.load(plant.write_robot(tmp_path, coulomb_friction=0.0, viscous_friction=0.0))
    runs = [replace(run, plan=None, simulated=None) for run in recorded(balancer)]
    found = explained(unknown, runs)
    true = {("coulomb_friction", joint): value for joint, value in enumerate(REAL.coulomb, start=1)}
    true |= {("viscous_friction", joint): value for joint, value in enumerate(REAL.viscous, start=1)}
    true[("spring_load", 2)] = 90.0
    told = {(f.effect, f.joint): next(iter(f.parameters.values())).value for f in found.findings.findings}
    assert told == pytest.approx(true, rel=0.1)


def slid(seed: int, offset: float, friction: float) -> Run:
    """The SCARA, the slide of which has a force and a friction that are not described."""
    time, q, qd, qdd = scara.motion(16.0, seed=seed)
    force = scara.torque(q, qd, qdd)
    force[:, 2] += offset + friction * qd[:, 2]
    random = np.random.default_rng(seed)
    noise = np.array([0.1, 0.05, 0.3]) * random.standard_normal(q.shape)
    return Run(f"run_0{seed}", time, q + 1e-6 * random.standard_normal(q.shape), qd, force + noise)


@pytest.mark.slow
def test_the_force_of_a_slide_is_told_in_newtons(tmp_path):
    found = explained(Arm.load(scara.write(tmp_path)), [slid(1, 8.0, 60.0), slid(2, 8.0, 60.0)])
    findings = {(f.effect, f.joint): f for f in found.findings.findings}
    assert set(findings) == {("torque_offset", 3), ("viscous_friction", 3)}
    offset, viscous = findings["torque_offset", 3], findings["viscous_friction", 3]
    assert offset.parameters["offset"].value == pytest.approx(8.0, abs=0.5)
    assert next(iter(viscous.parameters.values())).value == pytest.approx(60.0, rel=0.1)
    assert offset.parameters["offset"].unit == "N"
    assert viscous.parameters["coefficient"].unit == "N*s/m"
    assert "± 0.10 N, " in offset.statement
    assert "N·s/m" in viscous.statement
    assert [fit.unit for fit in found.findings.fit] == ["N*m", "N*m", "N"]
    assert offset.improvement.unit == "N"


def test_power_while_the_drives_are_off_is_not_that_of_brakes_or_standby(arm, tmp_path):
    tables = [off_before(measured(plant.record(f"run_{seed}", seed, plan=False)), 30.0) for seed in (1, 2)]
    files = [parquet(tmp_path / f"run_{i}.parquet", table) for i, table in enumerate(tables)]
    runs = read_runs(files, [], arm.description)
    notes = examine(runs, arm)[1]
    assert sum("the drives were off" in note for note in notes) == 2
    assert not any("filled in" in note for note in notes)
    assert named(explained(arm, runs)) == set()
