"""Arms with BAM's friction laws M1 to M6 (arXiv:2410.08650) beside a simulation that has M1: what ``explain`` names.

    python bench/bam.py OUT [--only MX-106,...] > table.md

Numbers are those published of three servos. The drives are M1's, so that friction alone differs. Errors are rms of
roll-outs begun anew each 2 s on runs that nothing is fitted to: of M1, of the mended file, of that with the callback
beside it, and of MuJoCo with the right law written into it at every step, as BAM does it.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from motion_alone import CREEP, STEP, Table, commands, mjcf, rolled
from numpy.typing import NDArray

Float = NDArray[np.float64]
Set = dict[str, float]

LAWS = """
servo      law  base   stribeck speed alpha motor  external motor_s external_s motor_q external_q viscous
MX-106     M1   0.1035 0        1     1     0      0        0       0          0       0          0.0352
MX-106     M2   0      0.1174   1.849 1.741 0      0        0       0          0       0          0.0596
MX-106     M3   0.1134 0        1     1     0.1082 0.1082   0       0          0       0          0.0119
MX-106     M4   0      0.1049   1.623 1.323 0.0092 0.0092   0.2224  0.2224     0       0          0.0510
MX-106     M5   0      0.1224   1.746 1.138 0.2076 0.0227   0.1952  0.0849     0       0          0.0507
MX-106     M6   0      0.1220   1.746 1.143 0.1980 0.0222   0.1986  0.0871     0.0100  0.0001     0.0507
eRob80:100 M1   5.6110 0        1     1     0      0        0       0          0       0          8.3923
eRob80:100 M2   0      5.4552   2.080 3.000 0      0        0       0          0       0          9.5707
eRob80:100 M3   4.8323 0        1     1     0.1480 0.1480   0       0          0       0          7.3953
eRob80:100 M4   0.0001 4.3817   1.977 3.000 0      0        0.1661  0.1661     0       0          9.0290
eRob80:100 M5   0.0009 3.8972   1.850 2.999 0.0014 0        0.0001  0.2545     0       0          8.8884
eRob80:100 M6   0.0005 5.2264   2.033 3.000 0.0489 0        0       0.0512     0.0027  0.0026     9.7093
XL-330     M1   0.0128 0        1     1     0      0        0       0          0       0          0.0037
XL-330     M2   0      0.0127   4.167 1.364 0      0        0       0          0       0          0.0056
XL-330     M3   0.0089 0        1     1     0.1217 0.1217   0       0          0       0          0.0044
XL-330     M4   0.0088 0        2.558 0.760 0.0680 0.0680   0.0738  0.0738     0       0          0.0046
XL-330     M5   0.0004 0.0087   3.189 2.990 0.2897 0        0       0.0587     0       0          0.0063
XL-330     M6   0.0048 0.0047   2.890 8.683 0.2668 0        0       0.0808     0.0100  0.0049     0.0054
"""
"""Nm, rad/s, Nm s/rad; shares of the torque of motor and links, ``_s`` at rest, ``_q`` 1/Nm of its square at rest."""
DRIVES = """
servo      kp     kv     most   armature
MX-106     56.1   1.620  11.09  0.0266
eRob80:100 382.9  108.3  91.9   0.9590
XL-330     0.831  0.0372 0.722  0.0018
"""
"""Nm/rad, Nm s/rad, Nm, kg m²: of P = 32 at 15 V, of kp = 50 with a damping of 2 up to 12 A, of P = 400 at 7.5 V."""
LINKS = {
    "MX-106": (((0, 0, 0.1), 0.35, (0, 0, 0.14), 4e-4), ((0, 0, 0.18), 0.75, (0, 0, 0.16), 6e-4)),
    "eRob80:100": (((0, 0, 0.2), 3.0, (0, 0, 0.25), 0.03), ((0, 0, 0.4), 4.5, (0, 0, 0.3), 0.04)),
    "XL-330": (((0, 0, 0.05), 0.04, (0, 0, 0.04), 1e-5), ((0, 0, 0.06), 0.06, (0, 0, 0.05), 2e-5)),
}
"""Place of each joint, and mass, centre and inertia of what it moves."""
FINE, COARSE = (2e-5, 2e-5), (2 * np.pi / 4096, 3e-4)
"""rad of an encoder's steps and noise."""


def numbers(table: str, keys: int) -> dict[tuple[str, ...], Set]:
    """The rows of a table by their first ``keys`` columns."""
    names, *rows = (line.split() for line in table.strip().splitlines())
    return {tuple(r[:keys]): dict(zip(names[keys:], map(float, r[keys:]), strict=True)) for r in rows}


def arm_on(servo: str, drive: Set, m1: Set) -> Table:
    """The arm of two joints on a servo, with its friction as M1 has it."""
    own = (drive["armature"], m1["base"], m1["viscous"], drive["kp"], drive["kv"], drive["most"])
    rows = tuple((place, "y", *link, *own) for place, *link in LINKS[servo])
    return Table(rows, 100, *(FINE if servo.startswith("eRob") else COARSE), 2.0)


def friction(law: Set, motor: Float, external: Float, speed: Float) -> Float:
    """The most (n,) Nm that dry friction brakes with."""
    slow = np.exp(-(np.abs(speed / law["speed"]) ** law["alpha"]))
    out = law["base"] + np.abs(external * law["external"] - motor * law["motor"])
    out = out + slow * np.abs(external * law["external_s"] - motor * law["motor_s"])
    driven = np.abs(external) < np.abs(motor)
    quad = np.where(driven, law["external_q"] * external**2, law["motor_q"] * motor**2)
    return np.asarray(out + slow * (law["stribeck"] + quad * (np.sign(external) != np.sign(motor))))


def moved(arm: Table, drive: Set, law: Set, told: Float) -> tuple[Float, Float]:
    """True positions and velocities of an arm with a law, told ``told`` (N, 2) rad."""
    model = mujoco.MjModel.from_xml_string(mjcf("bam", arm))
    model.dof_frictionloss[:] = model.dof_damping[:] = 0.0
    data, mass, per = mujoco.MjData(model), np.zeros((2, 2)), round(1 / arm.rate / STEP)
    q, v, out = told[0].copy(), np.zeros(2), (np.empty_like(told), np.empty_like(told))
    for k in range(len(told) * per):
        if k % per == 0:
            out[0][k // per], out[1][k // per] = q, v
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fullM(model, data, mass)
        motor = np.clip(drive["kp"] * (told[k // per] - q) - drive["kv"] * v, -drive["most"], drive["most"])
        most, turn = friction(law, motor, -data.qfrc_bias, v), np.tanh(v / CREEP)
        stiff = np.diag(most / CREEP * (1 - turn**2) + law["viscous"])
        push = motor - most * turn - law["viscous"] * v - data.qfrc_bias
        v = v + np.linalg.solve(mass + STEP * stiff, STEP * push)
        q = q + STEP * v
    return out


def written_in(drive: Set, law: Set) -> Callable[[Any, Any], None]:
    """A law in MuJoCo's own numbers, anew at every step."""

    def each(model: Any, data: Any) -> None:
        asked = drive["kp"] * (data.ctrl - data.qpos) - drive["kv"] * data.qvel
        motor = np.clip(asked, -drive["most"], drive["most"])
        model.dof_frictionloss[:] = friction(law, motor, -data.qfrc_bias, data.qvel)
        model.dof_damping[:] = law["viscous"]

    return each


def logs(folder: Path, arm: Table, drive: Set, law: Set) -> None:
    """Write the user's file, three logs, and the run that tells the truth."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.xml").write_text(mjcf("bam", arm))
    for i, kind in enumerate(("sines", "slow", "quick", "quick"), start=1):
        rng = np.random.default_rng([7, i])
        time, told = commands(arm, kind, 30.0, rng)
        q, v = moved(arm, drive, law, told)
        seen = np.round((q + rng.normal(0, arm.noisy, q.shape)) / arm.count) * arm.count
        columns = {"t": time} | {f"command_{j + 1}": told[:, j] for j in (0, 1)}
        more = {"q": seen} if i < 4 else {"true_q": q, "true_qd": v}
        columns |= {f"{c}_{j + 1}": values[:, j] for c, values in more.items() for j in (0, 1)}
        pq.write_table(pa.table(columns), folder / (f"run_{i}.parquet" if i < 4 else "held_out.parquet"))


def row(folder: Path, drive: Set, law: Set) -> str:
    """What ``explain`` names of an arm with a law, and the errors in mrad."""
    runs, file = map(str, sorted(folder.glob("run_*.parquet"))), str(folder / "arm.xml")
    words = ["cellwatt", "explain", *runs, "--simulation", file, "--mend", file, "--out", str(folder / "out")]
    subprocess.run([*words, "--no-report", "-q"], check=True, stdout=subprocess.DEVNULL)
    found = json.loads((folder / "out" / "findings.json").read_text())["findings"]
    named = ", ".join(f"{f['effect']} {f['joint']}" for f in found) or "nothing"
    user, mended = (mujoco.MjModel.from_xml_path(p) for p in (file, str(folder / "out" / "arm.mended.xml")))
    run, beside = folder / "held_out.parquet", folder / "out" / "arm_mended.py"
    errors = [rolled(user, run), rolled(mended, run)]
    if beside.exists():
        spec = importlib.util.spec_from_file_location("arm_mended", beside)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        module.attach(mended)
    errors.append(rolled(mended, run))
    mujoco.set_mjcb_passive(None)
    errors.append(rolled(user, run, written_in(drive, law)))
    return f"{named} | {' | '.join(f'{1000 * np.sqrt(np.mean(e**2)):.2f}' for e in errors)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", default="", help="servos, by name")
    given = parser.parse_args()
    drives, laws = numbers(DRIVES, 1), numbers(LAWS, 2)
    print("| servo | arm | named | M1, mrad | mended | with callback | BAM's law |\n|---|---|---|---|---|---|---|")
    for (servo, name), law in laws.items():
        if given.only and servo not in given.only.split(","):
            continue
        folder, drive = given.out / servo.replace(":", "_") / name, drives[servo,]
        logs(folder, arm_on(servo, drive, laws[servo, "M1"]), drive, law)
        print(f"| {servo} | {name} | {row(folder, drive, law)} |", flush=True)


if __name__ == "__main__":
    main()
