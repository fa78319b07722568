"""``mujoco.sysid`` beside ``cellwatt explain --mend``: the same logs, and runs that neither has seen.

    pip install "mujoco[sysid]"
    python bench/sysid.py CASES KEYS MENDED [--only CASE,...] [--iterations 8] > table.md

CASES, KEYS as ``motion_alone.py`` writes them; MENDED/CASE/arm.mended.xml is of ``cellwatt explain``. ``mujoco.sysid``
fits kp, kv, armature, friction loss and damping of all joints to the logs, rolled out anew each 2 s.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow.parquet as pq
from motion_alone import WINDOW, columns, rolled
from mujoco import sysid
from numpy.typing import NDArray
from scipy.signal import savgol_filter

Float = NDArray[np.float64]

EACH = 3
"""Each how manieth window is fitted to: all of them take a quarter of an hour."""
OFF = 0.1
"""Share by which a number is called wrong: the arms are off by 3 % at most, but for what the key names."""
BOUNDS = (0.1, 10.0)


def numbers(spec: Any) -> dict[str, tuple[float, Any]]:
    """Each number that is free: the user's, and how it is set."""
    out: dict[str, tuple[float, Any]] = {}
    for drive in spec.actuators:
        out[f"{drive.name} kp"] = drive.gainprm[0], lambda s, p, n=drive.name: sysid.apply_pgain(s, n, p.value[0])
        out[f"{drive.name} kv"] = -drive.biasprm[2], lambda s, p, n=drive.name: sysid.apply_dgain(s, n, p.value[0])
    for joint in spec.joints:
        for what in ("armature", "frictionloss", "damping"):
            own = float(np.ravel(getattr(joint, what))[0])
            out[f"{joint.name} {what}"] = own, partial(_set, joint.name, what)
    return out


def _set(joint: str, what: str, spec: Any, free: Any) -> None:
    value = float(free.value[0])
    setattr(spec.joint(joint), what, np.array([value, 0.0, 0.0]) if what == "damping" else value)


def fitted(case: Path, iterations: int) -> tuple[Any, dict[str, tuple[float, float]]]:
    """The model that ``mujoco.sysid`` makes of a user's file and its logs; numbers before and after."""
    spec = mujoco.MjSpec.from_file(str(case / "arm.xml"))
    for joint in spec.joints:
        spec.add_sensor(
            name=f"{joint.name}_q",
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint.name,
        )
    model = spec.compile()
    begun, told, seen = [], [], []
    for run in sorted(case.glob("run_*.parquet")):
        time = pq.read_table(run)["t"].to_numpy()
        step = float(time[1] - time[0])
        q, command = columns(run, "q", model.nv), columns(run, "command", model.nv)
        qd = savgol_filter(q, 9, 3, deriv=1, delta=step, axis=0)
        per, every = int(WINDOW / step), round(step / model.opt.timestep)
        for start in range(0, len(time) - per, EACH * per):
            rows = slice(start, start + per)
            control = np.repeat(command[rows], every, axis=0)
            begun.append(sysid.create_initial_state(model, q[start], qd[start]))
            told.append(sysid.TimeSeries(np.arange(len(control)) * model.opt.timestep, control))
            seen.append(sysid.TimeSeries.from_names(np.arange(per) * step, q[rows], model))
    free, params = numbers(spec), sysid.ParameterDict()
    typical = {
        what: np.median([v for n, (v, _) in free.items() if n.endswith(what)]) for what in ("loss", "ing", "ure")
    }
    for name, (value, modifier) in free.items():
        scale = value or next(float(v) for what, v in typical.items() if name.endswith(what))
        low = 0.0 if value == 0 else BOUNDS[0] * value
        params.add(sysid.Parameter(name, max(value, 0.1 * scale), low, BOUNDS[1] * scale, modifier=modifier))
    names = [f"window_{i}" for i in range(len(begun))]
    sequences = sysid.ModelSequences("arm", spec, names, begun, told, seen)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    found, _ = sysid.optimize(params, residual, optimizer="mujoco", verbose=False, max_iters=iterations)
    for name in free:
        free[name][1](spec, found[name])
    return spec.compile(), {name: (value, float(found[name].value[0])) for name, (value, _) in free.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", type=Path)
    parser.add_argument("keys", type=Path)
    parser.add_argument("mended", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--iterations", type=int, default=8)
    given = parser.parse_args()
    print(
        "| case | user's file | mujoco.sysid | cellwatt | numbers of mujoco.sysid that are off |\n|---|---|---|---|---|"
    )
    for case in sorted(given.cases.iterdir()):
        if given.only and case.name not in given.only.split(","):
            continue
        model, free = fitted(case, given.iterations)
        files = [
            mujoco.MjModel.from_xml_path(str(p))
            for p in (case / "arm.xml", given.mended / case.name / "arm.mended.xml")
        ]
        runs = sorted((given.keys / case.name).glob("holdout_*.parquet"))
        before, theirs, ours = (
            1000 * float(np.sqrt(np.mean(np.square([rolled(each, run) for run in runs]))))
            for each in (files[0], model, files[1])
        )
        wrong = [
            f"{n} {was:.3g} → {now:.3g}" for n, (was, now) in free.items() if abs(now - was) > OFF * max(was, 1e-9)
        ]
        print(f"| {case.name} | {before:.3f} | {theirs:.3f} | {ours:.3f} | {'; '.join(wrong)} |", flush=True)


if __name__ == "__main__":
    main()
