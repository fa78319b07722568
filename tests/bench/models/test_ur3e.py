"""What the benchmark says of the UR3e's links, against the maker's numbers and the arm's own controller."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from models import ur3e
from models.ur10e import TRAINED, UNSEEN
from real import ur10e

from cellwatt_plugins.robot import Body, load_robot

DATA = Path(__file__).resolve().parents[3] / ".." / "shared" / "data"
recorded = pytest.mark.skipif(not (DATA / ur3e.FOLDER).is_dir(), reason="the recordings of the UR3e are not here")


def frames(q):
    """Poses (4, 4) of the links' ends by Denavit and Hartenberg: Rz(q) Tz(d) Tx(a) Rx(α), joint by joint."""
    pose = np.eye(4)
    for angle, a, d, twist in zip(q, ur3e.LENGTH, ur3e.OFFSET, ur3e.TWIST, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        pose = pose @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
        yield pose


def columns(name, wanted):
    """Columns ``wanted_0`` … (N, 6) of a move."""
    text = (DATA / ur3e.FOLDER / f"{name}.csv").read_text(errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    rows = list(csv.DictReader(io.StringIO(text)))
    return np.array([[float(row[f"{wanted}_{i}"]) for i in range(6)] for row in rows])


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    robot = load_robot(ur3e.write_robot(tmp_path_factory.mktemp("robot")))
    return Body(robot.urdf, tuple(joint.name for joint in robot.joints))


def test_gravity_is_the_slope_of_the_height_of_the_centres(body):
    """By differences of the potential energy, from the parameters themselves and not from the URDF made of them."""

    def energy(q):
        *_, flange = poses = list(frames(q))
        links = sum(m * (pose @ [*c, 1])[2] for m, pose, c in zip(ur3e.MASS, poses, ur3e.CENTRE, strict=True))
        return 9.81 * (links + ur3e.PAYLOAD * (flange @ [*ur3e.PAYLOAD_CENTRE, 1])[2])

    for q in np.random.default_rng(0).uniform(-2, 2, (5, 6)):
        steps = 1e-6 * np.eye(6)
        slope = [(energy(q + step) - energy(q - step)) / 2e-6 for step in steps]
        np.testing.assert_allclose(body.gravity(q[None])[0], slope, atol=2e-3)


@recorded
@pytest.mark.parametrize("name", ur3e.MOVES)
def test_the_tool_is_where_the_controller_says(name):
    """A tool of 150 mm straight ahead of the flange, to the millimetre that the arm's calibration is worth."""
    for q, told in zip(columns(name, "actual_q"), columns(name, "actual_TCP_pose"), strict=True):
        *_, pose = frames(q)
        np.testing.assert_allclose(pose[:3, :3].T @ (told[:3] - pose[:3, 3]), [0, 0, 0.150], atol=0.0025)


@recorded
def test_torques_at_rest_are_those_that_the_controller_reckons_with(body):
    seen = 0
    for name in ur3e.MOVES:
        q, qd, moment = (columns(name, f"target_{what}") for what in ("q", "qd", "moment"))
        rest = np.abs(qd).max(axis=1) < 1e-4
        seen += int(rest.sum())
        np.testing.assert_allclose(body.gravity(q[rest]), moment[rest], atol=0.05)
    assert seen > 20


def test_no_recording_of_the_ur10e_is_judged_that_was_trained_on():
    bare = set(TRAINED)
    assert not bare & {*UNSEEN, ur10e.LOAD}
    assert ur10e.LOAD.removesuffix("Load") in UNSEEN  # the same path without the load was not trained on either
