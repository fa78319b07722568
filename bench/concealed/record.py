"""One case as files: description, recordings, simulations of the planned motion, and the key that stays sealed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from concealed.arms import Arm, Array
from concealed.describe import robot_yaml, urdf
from concealed.law import joint_torque, supply_power
from concealed.motion import Plan
from concealed.plant import Trace, ideal, simulate, tune
from concealed.sensing import Reading, at, read
from concealed.setting import Setting, require

Key = dict[str, Any]
TWO_MASS_SHOWS = 1.7
"""Least size, in units of the noise, of an effect that can only be sized by running the plant."""


def columns(**groups: Array) -> pa.Table:
    """A table of t (float64) and float32 columns; a group (N, n) becomes name_1 … name_n."""
    named: dict[str, Array] = {}
    for name, x in groups.items():
        if x.ndim == 1:
            named[name] = x if name == "t" else x.astype(np.float32)
        else:
            named |= {f"{name}_{j + 1}": x[:, j].astype(np.float32) for j in range(x.shape[1])}
    return pa.table(named)


def recording_table(r: Reading, with_temperature: bool) -> pa.Table:
    """What was measured, as the contract lays it out."""
    groups = {"t": r.t, "q": r.q, "qd": r.v, "tau": r.torque}
    if with_temperature and r.temperature is not None:
        groups["temperature"] = r.temperature
    return columns(**groups, power=r.power)


def planned(plan: Plan, t: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (N, n) of the plan at times t."""
    grid = np.arange(len(plan.q)) * plan.tick
    return at(t, grid, plan.q), at(t, grid, plan.v), at(t, grid, plan.a)


def simulation_table(believed: Arm, plan: Plan, t: Array) -> pa.Table:
    """What the simulation says for the planned motion."""
    q, v, a = planned(plan, t)
    torque = joint_torque(believed, q, v, a)
    return columns(t=t, q=q, qd=v, qdd=a, tau=torque, power=supply_power(believed, torque, v))


def rms(x: Array) -> Array:
    """RMS along time."""
    return np.asarray(np.sqrt(np.mean(np.square(x), axis=0)))


def true_power(s: Setting, trace: Trace, copy: int) -> Array:
    """(N,) supply power of one copy on the trace's grid."""
    return s.supply.power(trace.t, np.asarray(trace.torque[:, copy], float), np.asarray(trace.v[:, copy], float))


def perfect_trace(s: Setting) -> Trace:
    """The best that anyone could predict from the planned motion: the true plant as if it followed the plan."""
    return Trace(s.grid, s.t, s.q, s.v, s.a, ideal(s.body, s.q, s.v, s.a, s.t))


def present(s: Setting) -> Arm:
    """The arm without the effects: true figures, and zero where the simulation has none."""
    has = {name: getattr(s.believed, name) != 0.0 for name in ("coulomb", "viscous", "rotor", "resistance", "standby")}
    return replace(s.base, **{name: getattr(s.base, name) * there for name, there in has.items()})


def run_key(s: Setting, trace: Trace, perfect: Trace, copy: int, r: Reading, sim: pa.Table) -> Key:
    """Errors of one run per channel: simulation, best possible, size of the effect, noise."""
    seen = np.stack([sim[f"tau_{j + 1}"].to_numpy() for j in range(s.joints)], axis=1)
    rng = np.random.default_rng(0)
    if s.body.two_mass is None:
        best = read(rng, s.interface, perfect, copy, s.plans[copy].seconds, true_power(s, perfect, copy))
        best_torque, best_power = best.clean_torque, best.clean_power
    else:
        best_torque, best_power = r.clean_torque, r.clean_power
    skip = max(1, len(r.t) // 1500)
    q, v, a = (at(r.t[::skip], trace.t, np.asarray(x[:, copy], float)) for x in (trace.q, trace.v, trace.a))
    arm = present(s)
    torque = at(r.t[::skip], trace.t, np.asarray(trace.torque[:, copy], float))
    return {
        "rmse_simulation": rms(r.torque - seen).round(5).tolist(),
        "rmse_oracle": rms(r.torque - best_torque).round(5).tolist(),
        "effect_rms": rms(r.clean_torque[::skip] - joint_torque(arm, q, v, a)).round(5).tolist(),
        "noise": s.base.noise.round(5).tolist(),
        "power_rmse_simulation": float(rms(r.power - sim["power"].to_numpy()).round(4)),
        "power_rmse_oracle": float(rms(r.power - best_power).round(4)),
        "power_effect_rms": float(rms(r.clean_power[::skip] - supply_power(arm, torque, v)).round(4)),
        "power_noise": float(round(s.base.power_noise, 4)),
    }


def channel_sizes(runs: list[Key]) -> Array:
    """Size of all effects over the open runs in units of the noise, one value a joint and the last for the power."""
    rows = [r for r in runs if r["split"] == "open"]
    torque = rms(np.array([r["effect_rms"] for r in rows])) / np.array(rows[0]["noise"])
    return np.append(torque, rms(np.array([r["power_effect_rms"] for r in rows])) / rows[0]["power_noise"])


def write_run(s: Setting, trace: Trace, perfect: Trace, copy: int, case: Path, keys: Path) -> Key:
    """Write recording and simulation of one run to the folder where they belong; returns the run's part of the key."""
    plan, is_open = s.plans[copy], copy < s.opens
    run = f"run_{copy + 1:02d}" if is_open else f"holdout_{copy + 1:02d}"
    r = read(s.rng, s.interface, trace, copy, plan.seconds, true_power(s, trace, copy))
    sim = simulation_table(s.believed, plan, r.t)
    folder = case if is_open else keys
    pq.write_table(recording_table(r, s.shows_temperature), folder / f"{run}.recording.parquet")
    pq.write_table(sim, folder / f"{run}.simulation.parquet")
    head = {"run": run, "style": plan.style, "split": "open" if is_open else "sealed"}
    return head | run_key(s, trace, perfect, copy, r, sim)


def required(effects: list[Key]) -> list[Key]:
    """What an answer has to name: effects with joints from 1; those that are in no table are `unknown`."""
    return [
        {
            "effect": "unknown" if e["effect"].startswith("unknown_") else e["effect"],
            "joint": None if e["joint"] is None else e["joint"] + 1,
        }
        for e in effects
    ]


def shaken(s: Setting, sizes: Array) -> list[Key]:
    """Where two masses at one joint visibly shake others: saying `unknown` there is neither required nor wrong."""
    if s.body.two_mass is None:
        return []
    others = (j for j in range(s.joints) if j != s.body.two_mass.joint and sizes[j] > TWO_MASS_SHOWS)
    return [{"effect": "unknown", "joint": j + 1} for j in others]


def write_case(s: Setting, effects: list[Key], level: str, name: str, work: Path) -> Key:
    """Run the plant, write the open files to work/dev/name and the sealed ones with the key to work/keys/name.

    Raises NotVisibleError where two masses turn out not to show.
    """
    case, keys = work / "dev" / name, work / "keys" / name
    case.mkdir(parents=True, exist_ok=True)
    keys.mkdir(parents=True, exist_ok=True)
    (case / "robot.urdf").write_text(urdf(s.believed))
    (case / "robot.yaml").write_text(robot_yaml(s.believed, s.interface.rate))
    trace = simulate(s.body, s.plans, tune(s.rng, s.body, s.plans[0].tick))
    perfect = perfect_trace(s)
    runs = [write_run(s, trace, perfect, copy, case, keys) for copy in range(len(s.plans))]
    sizes = channel_sizes(runs)
    require(s.body.two_mass is None or bool(sizes[s.body.two_mass.joint] > TWO_MASS_SHOWS))
    key = {
        "id": name,
        "robot": s.base.family,
        "level": level,
        "run_set": s.run_set,
        "rate": s.interface.rate,
        "required": required(effects),
        "allowed": shaken(s, sizes),
        "ratio": float(sizes.max().round(2)),
        "effects": effects,
        "runs": runs,
    }
    (keys / "key.json").write_text(json.dumps(key, indent=1))
    return key
