"""An arm of seven joints of which no friction is known: MuJoCo moves it, friction is added here."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt_plugins.mismatch.api import explain

mujoco = pytest.importorskip("mujoco")

AXES = ("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
PLACES = ("0 0 .33", "0 0 0", "0 0 .32", ".08 0 0", "-.08 0 .38", "0 0 0", ".09 0 0")
MASSES = (4.6, 4.2, 3.4, 3.5, 2.6, 1.7, 1.0)
CENTRES = ("0 -.03 -.07", "0 .06 -.03", ".03 .03 -.05", "-.04 .04 .05", ".02 .03 .1", ".05 .02 .01", ".01 .01 .08")
SIZES = (0.06, 0.05, 0.03, 0.03, 0.03, 0.006, 0.005)
COULOMB = np.array([4.0, 5.0, 3.0, 3.5, 1.2, 0.9, 0.6])
VISCOUS = np.array([6.0, 7.0, 4.0, 4.0, 1.0, 0.8, 0.4])
NOISE = np.array([0.3, 0.4, 0.25, 0.25, 0.1, 0.08, 0.05])
RATE, SECONDS = 50.0, 16.0


def written(masses: np.ndarray) -> str:
    links = "".join(
        f'<body name="link{i}" pos="{place}"><joint name="joint{i}" axis="{axis}"/>'
        f'<inertial pos="{centre}" mass="{mass}" diaginertia="{size} {size} {0.7 * size}"/>'
        for i, (place, axis, centre, mass, size) in enumerate(
            zip(PLACES, AXES, CENTRES, masses, SIZES, strict=True), start=1
        )
    )
    return f'<mujoco><compiler angle="radian"/><worldbody>{links}{7 * "</body>"}</worldbody></mujoco>'


def torques(file: str, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    model = mujoco.MjModel.from_xml_string(file)
    data, out = mujoco.MjData(model), []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, qd, qdd, strict=True):
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse.copy())
    return np.array(out)


@pytest.mark.slow
def test_all_friction_of_an_arm_is_told_at_once(tmp_path):
    random = np.random.default_rng(3)
    time = np.arange(0.0, SECONDS, 1 / RATE)
    q, qd, qdd = np.zeros((3, len(time), 7))
    for k in range(1, 6):
        turns = 2 * np.pi * (0.06 * k + 0.007 * np.arange(7))
        phase, size = turns * time[:, None] + random.uniform(0, 6.28, 7), 0.6 / np.sqrt(k)
        q += size * np.sin(phase)
        qd += size * turns * np.cos(phase)
        qdd -= size * turns**2 * np.sin(phase)
    # Links as they are built: a few per cent off the file's.
    tau = torques(written(MASSES * (1 + 0.02 * random.normal(size=7))), q, qd, qdd)
    tau += COULOMB * np.tanh(qd / 0.005) + VISCOUS * qd + random.normal(size=q.shape) * NOISE
    groups = {"q": q + 2e-5 * random.normal(size=q.shape), "qd": qd, "tau": tau}
    columns = {f"{name}_{j + 1}": values[:, j] for name, values in groups.items() for j in range(7)}
    pq.write_table(pa.table({"t": time} | columns), tmp_path / "run.parquet")
    (tmp_path / "arm.xml").write_text(written(np.array(MASSES)))

    found = explain(tmp_path / "run.parquet", simulation=tmp_path / "arm.xml").findings
    told = {(f.effect, f.joint): next(iter(f.parameters.values())).value for f in found.findings}
    true = {("coulomb_friction", j): value for j, value in enumerate(COULOMB, start=1)}
    true |= {("viscous_friction", j): value for j, value in enumerate(VISCOUS, start=1)}
    assert told == pytest.approx(true, rel=0.1)
    assert not any("time was up" in note for note in found.notes)
    # A law that holds more than friction by speed is no better name for it.
    assert all(f.confidence > 0.9 for f in found.findings)
