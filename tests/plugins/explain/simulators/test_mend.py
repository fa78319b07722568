"""A simulator is mended from recordings of an arm in closed form, and asked about a motion that nobody recorded."""

import json

import numpy as np
import pytest

from cellwatt.commands import EXIT_USAGE
from cellwatt_plugins.explain.simulators import load_simulator
from tests.plugins.explain import plant
from tests.plugins.explain.calling import call
from tests.plugins.explain.plant import REAL, Missing, column, loaded, turned

pytest.importorskip("mujoco")

JOINTS = ("axis_1", "axis_2", "axis_3")
RUNS = ("run_01", "run_02")
HEAVY = loaded(REAL, 2.0, 0.12)


def stribeck(time, q, qd, run):
    return column(4 * np.exp(-((qd[:, 1] / 0.15) ** 2)) * turned(qd[:, 1]), 2)


def offset(torque):
    return torque + np.array([0, 0, 1.5])


def mjcf(arm):
    """The nominal arm as its user has it in MuJoCo: yaw, shoulder and elbow, joints by a class of their own."""
    masses, centres = (10.0, *arm.masses), (0.0, *arm.centres)
    inertias = [(0.01, 0.8, 0.8), *((x, t, t) for x, t in zip(arm.axial, arm.transverse, strict=True))]
    lines = ['<mujoco model="plant">', '<compiler angle="degree"/>', "<!-- of the catalogue -->", "<worldbody>"]
    for i, (axis, place) in enumerate((("0 0 1", "0 0 0.4"), ("0 1 0", "0 0 0"), ("0 1 0", f"{arm.length} 0 0"))):
        lines += [
            f'<body name="link_{i + 1}" pos="{place}">',
            f'<joint name="axis_{i + 1}" axis="{axis}" frictionloss="{arm.coulomb[i]}" damping="{arm.viscous[i]}" '
            f'armature="{arm.rotor[i]}"/>',
            f'<inertial pos="{centres[i]} 0 0" mass="{masses[i]}" '
            f'diaginertia="{" ".join(str(x) for x in inertias[i])}"/>',
        ]
    return "\n".join([*lines, 3 * "</body>", "</worldbody>", "</mujoco>"])


def explain(cell, simulator, out):
    files = [[cell / f"{name}.{kind}.parquet" for name in RUNS] for kind in ("recording", "simulation")]
    words = ["explain", *files[0], "--simulation", *files[1], "--robot", cell, "--no-report"]
    return call(*words, "--mend", simulator, "--out", out)


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """Robot, recordings with plans, and the user's file, which lacks a payload, Stribeck friction and an offset."""
    folder = tmp_path_factory.mktemp("cell")
    plant.write_robot(folder)
    (folder / "arm.xml").write_text(mjcf(plant.NOMINAL))
    for seed, name in enumerate(RUNS, start=1):
        missing = Missing(arm=HEAVY, added=stribeck, read=offset)
        plant.write(folder, plant.record(name, seed, missing, 16.0, power=False))
    return folder


@pytest.fixture(scope="module")
def mended(cell):
    """What `explain --mend` says, and its entry in findings.json."""
    code, out, err = explain(cell, cell / "arm.xml", cell / "out")
    assert code == 0, err
    return out, json.loads((cell / "out" / "findings.json").read_text())["mended"]


def test_the_mended_file_moves_like_the_real_arm(cell, mended):
    """On a motion that nobody recorded, with all that the arm has: the file holds what can be said nearest to it."""
    time = np.arange(0, 30, 0.01)
    motion = plant.moves(77, 30.0)(time)
    real = offset(plant.motors(HEAVY, *motion) + stribeck(time, motion[0], motion[1], "run_09"))
    # MuJoCo's own friction is soft, and turns over before the velocity.
    clear = np.abs(motion[1]) > 0.05
    before, after = (
        np.sqrt(np.mean((load_simulator(file, JOINTS).torque(*motion) - real) ** 2, axis=0, where=clear))
        for file in (cell / "arm.xml", cell / "out" / "arm.mended.xml")
    )
    assert np.all(before > [0.4, 3.0, 0.8])
    # MuJoCo's dry friction turns over some ms before the velocity does.
    assert np.all(after < [0.25, 1.5, 0.2])


def test_what_is_written_is_said_with_its_place_and_unit(cell, mended):
    out, entry = mended
    written = {(change["where"], change["what"]): change for change in entry["applied"]}
    assert entry["path"] == str(cell / "out" / "arm.mended.xml")
    assert written["body payload", "mass"]["value"] == pytest.approx(2.0, abs=0.15)
    assert written["body payload", "mass"]["unit"] == "kg"
    assert written["body payload", "centre of mass"]["value"][0] == pytest.approx(0.12, abs=0.03)
    assert written["joint axis_1", "frictionloss"]["was"] == plant.NOMINAL.coulomb[0]
    assert written["joint axis_1", "frictionloss"]["value"] == pytest.approx(REAL.coulomb[0], rel=0.03)
    assert f"mended: {cell / 'out' / 'arm.mended.xml'}" in out
    assert "body payload: mass" in out


def test_what_the_file_cannot_say_is_told_with_its_torque(mended):
    left = {(entry["effect"], entry["joint"]): entry for entry in mended[1]["left"]}
    assert set(left) == {("stribeck_friction", 2)}
    assert left["stribeck_friction", 2]["why"] == "the simulator has no such term"
    assert 0.5 < left["stribeck_friction", 2]["rms"] < 4.0


def test_errors_are_those_of_blocks_left_out(mended):
    """Joints 1 and 3 come down to their noise; joint 2 keeps what the file cannot say."""
    error = {entry["channel"]: entry for entry in mended[1]["error"]}
    first, second, third = (error[f"tau_{i}"] for i in (1, 2, 3))
    assert first["after"] < 1.15 * plant.TORQUE_NOISE[0] < first["before"]
    assert second["after"] < 0.5 * second["before"]
    assert third["after"] < 1.15 * plant.TORQUE_NOISE[2] < third["before"]


def test_the_users_text_stays(cell, mended):
    text = (cell / "out" / "arm.mended.xml").read_text()
    assert (cell / "arm.xml").read_text() == mjcf(plant.NOMINAL)
    assert "<!-- of the catalogue -->" in text
    assert '<body name="link_2" pos="0 0 0">' in text


def test_another_arm_is_refused_before_anything_is_fitted(cell, tmp_path):
    other = tmp_path / "other.xml"
    other.write_text(mjcf(plant.NOMINAL).replace('axis="0 0 1"', 'axis="1 0 0"'))
    code, _, err = explain(cell, other, tmp_path / "out")
    assert code == EXIT_USAGE
    assert "other.xml: the axis of axis_1 differs" in err
    assert not (tmp_path / "out").exists()
