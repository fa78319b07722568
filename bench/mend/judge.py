"""A simulator's file on motion that nobody was shown: MuJoCo's own inverse dynamics, nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pyarrow.parquet as pq
from concealed.arms import Array
from concealed.law import SIGN_WIDTH, inverse
from concealed.product import predict


@dataclass(frozen=True)
class Motion:
    """Planned motion (N, n) with what was measured, Nm."""

    q: Array
    v: Array
    a: Array
    measured: Array


def motion(folder: Path, run: str, joints: int) -> Motion:
    """One run's plan and recording."""
    plan, recorded = (pq.read_table(folder / f"{run}.{kind}.parquet") for kind in ("simulation", "recording"))
    of = lambda table, name: np.stack([table[f"{name}_{j + 1}"].to_numpy() for j in range(joints)], axis=1)  # noqa: E731
    return Motion(*(of(plan, name).astype(float) for name in ("q", "qd", "qdd")), of(recorded, "tau").astype(float))


def torque(model: mujoco.MjModel, q: Array, v: Array, a: Array, soft: bool = False) -> Array:
    """(N, n) Nm by ``mj_inverse``; dry friction as the file states it, or ``soft`` as MuJoCo's constraint steps it."""
    flags = model.opt.disableflags
    if not soft:
        model.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
    out = inverse(model, mujoco.MjData(model), q, v, a)
    model.opt.disableflags = flags
    return out if soft else np.asarray(out + model.dof_frictionloss * np.tanh(v / SIGN_WIDTH))


def error(model: mujoco.MjModel, runs: list[Motion], soft: bool = False) -> Array:
    """(n,) Nm rms of measured less simulated torque over all runs."""
    return rms([torque(model, run.q, run.v, run.a, soft) for run in runs], runs)


def error_of_model(command: str, out: Path, sealed: Path, names: list[str], runs: list[Motion]) -> Array:
    """(n,) Nm rms of what `cellwatt simulate` says of the sealed plans, with all that was found."""
    said = [predict(command, out, sealed / f"{name}.recording.parquet") for name in names]
    if missing := [name for name, own in zip(names, said, strict=True) if own is None]:
        raise SystemExit(f"cellwatt simulate failed on {', '.join(missing)}")
    return rms([own[0] for own in said if own is not None], runs)


def rms(said: list[Array], runs: list[Motion]) -> Array:
    """(n,) Nm rms of measured less said torque."""
    left = np.concatenate([run.measured - own for own, run in zip(said, runs, strict=True)])
    return np.asarray(np.sqrt(np.mean(left**2, axis=0)))
