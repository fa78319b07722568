"""``explain`` from commands and motion, without torque: a planar arm on servos, its dynamics in closed form."""

import json

import numpy as np
import pytest

from cellwatt.tables import write_table
from cellwatt_plugins.explain import api
from cellwatt_plugins.explain.command import explain
from cellwatt_plugins.explain.input.driven import driven
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.input.sources import sources
from cellwatt_plugins.explain.simulators import load_simulator
from cellwatt_plugins.explain.simulators.rollout import WINDOW, rms_of, rolled_out
from cellwatt_plugins.explain.verdict.other_recordings import compare, with_others
from cellwatt_plugins.robot.servo.law import servo_of
from tests.calling import called
from tests.plugins.explain.logs import numbered
from tests.plugins.explain.servos import FORCE, KP, KV, PLANTS, ROW, Plant, integrated, mjcf, moves, sines
from tests.plugins.robot import planar_arm

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def logs():
    return dict(zip(PLANTS, integrated(list(PLANTS.values())), strict=True))


def explained(folder, log, *words):
    if isinstance(log, tuple):
        time, told, seen = log
        log = folder / "log.parquet"
        write_table(log, {"t": time, **numbered("command", told), **numbered("q", seen)})
    if not (folder / "arm.xml").exists():
        (folder / "arm.xml").write_text(mjcf())
    given = [str(log), "--simulation", str(folder / "arm.xml"), "--out", str(folder / "out")]
    words = words or ("--no-report",)
    called(explain, *given, "-q", *words)
    found = json.loads((folder / "out" / "findings.json").read_text())
    return found, {(f["effect"], f["joint"]): f["parameters"] for f in found["findings"]}


def test_servos_are_read_with_their_gears(tmp_path):
    (tmp_path / "arm.xml").write_text(mjcf().replace('kp="400.0"', 'gear="2" kp="400.0"'))
    servo = servo_of(tmp_path / "arm.xml", ["shoulder", "elbow"])
    assert servo.stiffness.tolist() == [900.0, 1600.0]
    assert servo.pull.tolist() == [900.0, 800.0]
    assert servo.damping.tolist() == [45.0, 72.0]
    assert servo.high.tolist() == [200.0, 400.0]


def test_an_arm_that_follows_its_file_has_no_mismatch(tmp_path, logs):
    assert explained(tmp_path, logs["null"])[1] == {}


def test_commands_that_come_more_seldom_than_rows_are_no_rattling(tmp_path):
    """Each step of the commands, 33 a second, shakes the joints faster than the filtered motion shows."""
    (log,) = integrated([Plant()], 1.5 * np.repeat(sines()[::3], 3, axis=0))
    assert explained(tmp_path, log)[1] == {}


def test_rows_whose_new_command_exceeds_the_limit_count_little(tmp_path):
    """The joint follows within the row: the filtered motion does not show how much torque the limit takes."""
    force, log, xml = 60.0, tmp_path / "log.parquet", tmp_path / "arm.xml"
    xml.write_text(mjcf().replace(f"{FORCE}", f"{force}"))
    ((time, told, seen),) = integrated([Plant(force=(force, force))], np.repeat(sines()[::5], 5, axis=0))
    write_table(log, {"t": time, **numbered("command", told), **numbered("q", seen)})
    problem = api.explain([log], robot=api.arm_of(None, xml, [log]), simulation=[xml]).torque.problem
    asked = KP * (told - seen) - KV * np.gradient(seen, ROW, axis=0)
    beyond = np.abs(asked[:: problem.rows[0].every, 0]) > force + 5
    deviation = np.sqrt(problem.variance[0][:, 0]) / problem.floor[0]
    assert np.count_nonzero(beyond) > 10
    assert np.median(deviation[beyond]) > 5
    assert np.median(deviation) < 2


def test_friction_of_a_slide_reverses_within_a_lower_speed_than_that_of_a_hinge(tmp_path):
    """A lift of 19 kg with friction of 150 N, which reverses within 1 mm/s."""
    kp, kv, mass, step = 3e4, 1500.0, 5.0, 0.001
    (tmp_path / "arm.xml").write_text(
        '<mujoco><option timestep="0.001"/><worldbody><body><inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>'
        '<joint name="lift" type="slide" axis="0 0 1" armature="14" frictionloss="150" damping="60"/></body>'
        f'</worldbody><actuator><position joint="lift" kp="{kp}" kv="{kv}"/></actuator></mujoco>'
    )
    told = 0.1 * np.concatenate([sines()[:, 0], moves(6)[:, 0]])
    seen, place, speed = np.empty_like(told), told[0], 0.0
    for row, command in enumerate(told):
        seen[row] = place
        for _ in range(round(ROW / step)):
            sign = np.tanh(speed / 0.001)
            push = kp * (command - place) - kv * speed - 150 * sign - 60 * speed - 9.81 * mass
            speed += step * push / (19 + step * (kv + 60 + 150 / 0.001 * (1 - sign**2)))
            place += step * speed
    assert explained(tmp_path, (ROW * np.arange(len(told)), told[:, None], np.round(seen, 6)[:, None]))[1] == {}


def test_the_page_rolls_out_the_simulators_file_and_not_the_description(tmp_path, logs):
    planar_arm.write(tmp_path)
    joints = [{"name": name} for name in ("shoulder", "elbow")]
    robot = tmp_path / "robot.yaml"
    robot.write_text(json.dumps({"robot": "planar", "urdf": "arm.urdf", "joints": joints}))
    assert explained(tmp_path, logs["null"], "--robot", str(robot))[1] == {}
    assert "How the arm and its simulation move" in (tmp_path / "out" / "report.html").read_text()


def test_a_soft_loop_is_named_and_mended(tmp_path, logs):
    found, named = explained(tmp_path, logs["gain"], "--mend", str(tmp_path / "arm.xml"))
    assert named.keys() == {("drive_gain", 2)}
    assert "How the arm and its simulation move" in (tmp_path / "out" / "report.html").read_text()
    assert named["drive_gain", 2]["gain"]["value"] == pytest.approx(-0.3, abs=0.03)
    before, after = ([e[key] for e in found["mended"]["error"]] for key in ("before", "after"))
    assert after[1] < 0.2 * before[1]
    assert after[0] < 1.02 * before[0]
    kp = mujoco.MjModel.from_xml_path(found["mended"]["path"]).actuator_gainprm[1, 0]
    assert kp == pytest.approx(0.7 * KP[1], rel=0.03)


def test_what_the_file_cannot_hold_is_a_callback_beside_it(tmp_path, logs, monkeypatch):
    found, named = explained(tmp_path, logs["dead"], "--mend", str(tmp_path / "arm.xml"))
    assert named.keys() == {("drive_dead_band", 2)}
    assert named["drive_dead_band", 2]["half_width"]["value"] == pytest.approx(0.008, rel=0.15)
    (left,) = found["mended"]["left"]
    assert (left["effect"], left["joint"], left["unit"]) == ("drive_dead_band", 2, "rad")
    monkeypatch.syspath_prepend(tmp_path / "out")
    import arm_mended

    time, told, seen = logs["dead"]
    model = mujoco.MjModel.from_xml_path(found["mended"]["path"])

    def error():
        data, off = mujoco.MjData(model), []
        data.qpos[:], data.ctrl[:] = seen[0], told[0]
        for row in range(len(time) - 1):
            data.ctrl[:] = told[row]
            mujoco.mj_step(model, data, 10)
            off.append(data.qpos - seen[row + 1])
        return float(np.sqrt(np.mean(np.square(off), axis=0))[1])

    without = error()
    try:
        arm_mended.attach(model)
        assert error() < 0.4 * without
    finally:
        mujoco.set_mjcb_passive(None)


def test_another_recording_is_not_compared_by_gains_that_the_model_does_not_have(tmp_path, logs):
    """Those of the file are 1 % off, which is no finding, and 20 times the error on data left out."""
    (tmp_path / "arm.xml").write_text(mjcf())
    time, told, seen = logs["null"]
    write_table(tmp_path / "log.parquet", {"t": time, **numbered("command", told), **numbered("q", seen)})
    log, arm = tmp_path / "log.parquet", tmp_path / "arm.xml"
    found = api.explain([log], simulation=[arm])
    (other,) = compare(sources([log], [arm]), found.findings, found.model, arm, 1 / ROW)
    assert other.explained is None
    said = with_others(found.findings, [other], 1)
    assert said.verdict == "no_mismatch"
    assert any(note.endswith("were looked at closely; no other one was compared") for note in said.notes)


def test_a_run_shorter_than_a_window_is_rolled_out_whole(tmp_path, logs):
    (tmp_path / "arm.xml").write_text(mjcf())
    time, told, seen = (part[:101] for part in logs["null"])
    simulator = load_simulator(tmp_path / "arm.xml", ("shoulder", "elbow"))
    runs = driven([Run("short", time, seen, None, np.full_like(seen, np.nan), command=told)], simulator)
    assert time[-1] - time[0] < WINDOW
    assert np.isfinite(rms_of(rolled_out(simulator.path, simulator.joints, runs))).all()


@pytest.mark.parametrize(
    ("plant", "place", "number", "value"),
    [
        ("late", ("time_delay", None), "delay", 0.03),
        ("rough", ("coulomb_friction", 1), "force", 1.5),
        ("weak", ("torque_saturation", 1), "limit", 47.0),
    ],
)
def test_what_is_missing_is_named(tmp_path, logs, plant, place, number, value):
    _, named = explained(tmp_path, logs[plant])
    assert named.keys() == {place}
    assert named[place][number]["value"] == pytest.approx(value, rel=0.15)
