"""Arms with BAM's friction laws M1 to M6 (arXiv:2410.08650) beside a simulation that has M1: what ``explain`` names.

    python bench/bam.py OUT > table.md

Numbers are those published of the Dynamixel MX-106; the servos are M1's, so that friction alone differs. Errors are rms
of roll-outs begun anew each 2 s on runs that nothing is fitted to: of M1, of the mended file, of that with the callback
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
from motion_alone import CREEP, STEP, Table, commands, mjcf
from numpy.typing import NDArray

Float = NDArray[np.float64]
Set = dict[str, float]

KT, R, VOLT, GAIN = 2.1914, 2.965, 15.0, 5.06
"""Nm/A, Ohm, V, and duty per rad at P = 32."""
KP, KV, MOST = KT / R * VOLT * GAIN, KT**2 / R, KT / R * VOLT
M1: Set = {"base": 0.1035, "viscous": 0.0352}
LAWS: dict[str, Set] = {
    "M1": M1,
    "M2": {"base": 0.0, "stribeck": 0.1174, "speed": 1.849, "alpha": 1.741, "viscous": 0.0596},
    "M3": {"base": 0.1134, "motor": 0.1082, "external": 0.1082, "viscous": 0.0119},
    "M4": {"base": 0.0, "stribeck": 0.1049, "motor": 0.0092, "external": 0.0092, "motor_stribeck": 0.2224}
    | {"external_stribeck": 0.2224, "speed": 1.623, "alpha": 1.323, "viscous": 0.0510},
    "M5": {"base": 0.0, "stribeck": 0.1224, "motor": 0.2076, "external": 0.0227, "motor_stribeck": 0.1952}
    | {"external_stribeck": 0.0849, "speed": 1.746, "alpha": 1.138, "viscous": 0.0507},
    "M6": {"base": 0.0, "stribeck": 0.1220, "motor": 0.1980, "external": 0.0222, "motor_stribeck": 0.1986}
    | {"external_stribeck": 0.0871, "motor_quad": 0.0100, "external_quad": 0.0001}
    | {"speed": 1.746, "alpha": 1.143, "viscous": 0.0507},
}
ARM = Table(
    (
        ((0, 0, 0.1), "y", 0.35, (0, 0, 0.14), 4e-4, 0.0266, M1["base"], M1["viscous"], KP, KV, MOST),
        ((0, 0, 0.18), "y", 0.75, (0, 0, 0.16), 6e-4, 0.0266, M1["base"], M1["viscous"], KP, KV, MOST),
    ),
    100,
    2 * np.pi / 4096,
    0.0003,
    2.0,
)


def friction(law: Set, motor: Float, external: Float, speed: Float) -> Float:
    """The most (n,) Nm that dry friction brakes with."""

    def of(name: str) -> float:
        return law.get(name, 0.0)

    slow = np.exp(-(np.abs(speed / of("speed")) ** of("alpha"))) if "speed" in law else np.zeros_like(speed)
    out = of("base") + np.abs(external * of("external") - motor * of("motor"))
    out = out + slow * np.abs(external * of("external_stribeck") - motor * of("motor_stribeck"))
    driven = np.abs(external) < np.abs(motor)
    quad = np.where(driven, of("external_quad") * external**2, of("motor_quad") * motor**2)
    return np.asarray(out + slow * (of("stribeck") + quad * (np.sign(external) != np.sign(motor))))


def arm(law: Set, time: Float, told: Float) -> tuple[Float, Float]:
    """True positions and velocities at ``time`` of an arm with a law."""
    model = mujoco.MjModel.from_xml_string(mjcf("bam", ARM))
    model.dof_frictionloss[:] = model.dof_damping[:] = 0.0
    data, mass, per = mujoco.MjData(model), np.zeros((2, 2)), round(1 / ARM.rate / STEP)
    q, v, out = told[0].copy(), np.zeros(2), (np.empty_like(told), np.empty_like(told))
    for k in range(len(told) * per):
        if k % per == 0:
            out[0][k // per], out[1][k // per] = q, v
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fullM(model, data, mass)
        motor = np.clip(KP * (told[k // per] - q) - KV * v, -MOST, MOST)
        most, turn = friction(law, motor, -data.qfrc_bias, v), np.tanh(v / CREEP)
        stiff = np.diag(most / CREEP * (1 - turn**2) + law["viscous"])
        push = motor - most * turn - law["viscous"] * v - data.qfrc_bias
        v = v + np.linalg.solve(mass + STEP * stiff, STEP * push)
        q = q + STEP * v
    return out


def error(model: Any, run: Path, each: Callable[[Any, Any], None] = lambda model, data: None) -> float:
    """rms, mrad, of a model rolled out; ``each`` step may change it."""
    table, data, off = pq.read_table(run), mujoco.MjData(model), []
    told, q, qd = (
        np.column_stack([table[f"{c}_{j}"].to_numpy() for j in (1, 2)]) for c in ("command", "true_q", "true_qd")
    )
    per, steps = round(2 * ARM.rate), round(1 / ARM.rate / model.opt.timestep)
    for start in range(0, len(q) - per, per):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = q[start], qd[start]
        for i in range(start, start + per):
            data.ctrl[:] = told[i]
            for _ in range(steps):
                each(model, data)
                mujoco.mj_step(model, data)
            off.append(data.qpos - q[i + 1])
    return 1000 * float(np.sqrt(np.mean(np.square(off))))


def written_in(law: Set) -> Callable[[Any, Any], None]:
    """A law in MuJoCo's own numbers, anew at every step."""

    def each(model: Any, data: Any) -> None:
        motor = np.clip(KP * (data.ctrl - data.qpos) - KV * data.qvel, -MOST, MOST)
        model.dof_frictionloss[:] = friction(law, motor, -data.qfrc_bias, data.qvel)
        model.dof_damping[:] = law["viscous"]

    return each


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    print("| arm | named | M1, mrad | mended | with callback | BAM's law |\n|---|---|---|---|---|---|")
    for name, law in LAWS.items():
        folder = given.out / name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "arm.xml").write_text(mjcf("bam", ARM))
        for i, kind in enumerate(("sines", "slow", "quick", "quick"), start=1):
            rng = np.random.default_rng([7, i])
            time, told = commands(ARM, kind, 30.0, rng)
            q, v = arm(law, time, told)
            seen = np.round((q + rng.normal(0, ARM.noisy, q.shape)) / ARM.count) * ARM.count
            columns = {"t": time} | {f"command_{j + 1}": told[:, j] for j in (0, 1)}
            more = {"q": seen} if i < 4 else {"true_q": q, "true_qd": v}
            columns |= {f"{c}_{j + 1}": values[:, j] for c, values in more.items() for j in (0, 1)}
            pq.write_table(pa.table(columns), folder / (f"run_{i}.parquet" if i < 4 else "held_out.parquet"))
        runs, file = sorted(folder.glob("run_*.parquet")), str(folder / "arm.xml")
        words = [
            "cellwatt",
            "explain",
            *map(str, runs),
            "--simulation",
            file,
            "--mend",
            file,
            "--out",
            str(folder / "out"),
        ]
        subprocess.run([*words, "--no-report", "-q"], check=True, stdout=subprocess.DEVNULL)
        found = json.loads((folder / "out" / "findings.json").read_text())["findings"]
        named = ", ".join(f"{f['effect']} {f['joint']}" for f in found) or "nothing"
        user, mended = (mujoco.MjModel.from_xml_path(p) for p in (file, str(folder / "out" / "arm.mended.xml")))
        run, beside = folder / "held_out.parquet", folder / "out" / "arm_mended.py"
        errors = [error(user, run), error(mended, run)]
        if beside.exists():
            spec = importlib.util.spec_from_file_location("arm_mended", beside)
            assert spec is not None and spec.loader is not None
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            module.attach(mended)
        errors.append(error(mended, run))
        mujoco.set_mjcb_passive(None)
        errors.append(error(user, run, written_in(law)))
        print(f"| {name} | {named} | {' | '.join(f'{e:.2f}' for e in errors)} |", flush=True)


if __name__ == "__main__":
    main()
