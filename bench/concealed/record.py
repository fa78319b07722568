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
from concealed.own import Own
from concealed.plant import Trace, ideal, simulate, tune
from concealed.sensing import Reading, at, read
from concealed.setting import Setting, require
from concealed.simulation import own_times, said, torque_of
from concealed.supply import Supply

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


def simulator_table(s: Setting, copy: int) -> pa.Table | None:
    """The planned motion as a simulation with its own step and clock writes it; None where it has none."""
    if (clock := s.simulation.clock) is None:
        return None
    t = own_times(clock, s.plans[copy].seconds)
    return columns(t=t + clock.lead + clock.start, **said(s.believed, s.simulation, s.plans[copy], t))


def rms(x: Array) -> Array:
    """RMS along time."""
    return np.asarray(np.sqrt(np.mean(np.square(x), axis=0)))


def true_power(s: Setting, trace: Trace, copy: int) -> Array:
    """(N,) supply power of one copy on the trace's grid."""
    return s.supply.power(trace.t, np.asarray(trace.torque[:, copy], float), np.asarray(trace.v[:, copy], float))


def present(s: Setting) -> Arm:
    """The arm without the effects: true figures, and zero where the simulation has none."""
    has = {name: getattr(s.believed, name) != 0.0 for name in ("coulomb", "viscous", "rotor", "resistance", "standby")}
    return replace(s.base, **{name: getattr(s.base, name) * there for name, there in has.items()})


def present_supply(s: Setting) -> Supply:
    """The supply without the effects."""
    arm = present(s)
    return replace(s.simulation.true_supply or Supply.of(arm), standby=arm.standby, resistance=arm.resistance)


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
    expected = torque_of(present(s), s.simulation.true_frictions, r.t[::skip], q, v, a)
    torque = at(r.t[::skip], trace.t, np.asarray(trace.torque[:, copy], float))
    supplied = present_supply(s).power(r.t[::skip], torque, v)
    return {
        "rmse_simulation": rms(r.torque - seen).round(5).tolist(),
        "rmse_oracle": rms(r.torque - best_torque).round(5).tolist(),
        "effect_rms": rms(r.clean_torque[::skip] - expected).round(5).tolist(),
        "noise": s.base.noise.round(5).tolist(),
        "power_rmse_simulation": float(rms(r.power - sim["power"].to_numpy()).round(4)),
        "power_rmse_oracle": float(rms(r.power - best_power).round(4)),
        "power_effect_rms": float(rms(r.clean_power[::skip] - supplied).round(4)),
        "power_noise": float(round(s.base.power_noise, 4)),
    }


def channel_sizes(runs: list[Key]) -> Array:
    """Size of all effects over the open runs in units of the noise, one value a joint and the last for the power."""
    rows = [r for r in runs if r["split"] == "open"]
    torque = rms(np.array([r["effect_rms"] for r in rows])) / np.array(rows[0]["noise"])
    return np.append(torque, rms(np.array([r["power_effect_rms"] for r in rows])) / rows[0]["power_noise"])


def write_run(s: Setting, trace: Trace, perfect: Trace, copy: int, case: Path, keys: Path) -> Key:
    """Write recording and simulation of one run to the folder where they belong; returns the run's part of the key.

    Of a simulation with its own clock, the key has the samples at the recording's times too, for the scores; what it
    writes itself for a sealed run is `.simulator.parquet`.
    """
    plan, is_open = s.plans[copy], copy < s.opens
    run = f"run_{copy + 1:02d}" if is_open else f"holdout_{copy + 1:02d}"
    r = read(s.rng, s.interface, trace, copy, plan.seconds, true_power(s, trace, copy))
    sim, own = columns(t=r.t, **said(s.believed, s.simulation, plan, r.t)), simulator_table(s, copy)
    folder = case if is_open else keys
    pq.write_table(recording_table(r, s.shows_temperature), folder / f"{run}.recording.parquet")
    pq.write_table(sim, (folder if own is None else keys) / f"{run}.simulation.parquet")
    if own is not None:
        pq.write_table(own, case / f"{run}.simulation.parquet" if is_open else keys / f"{run}.simulator.parquet")
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


def write_case(s: Setting, effects: list[Key], level: str, name: str, work: Path, own: Own | None = None) -> Key:
    """Run the plant, write the open files to work/dev/name and the sealed ones with the key to work/keys/name.

    Raises NotVisibleError where two masses turn out not to show.
    """
    case, keys = work / "dev" / name, work / "keys" / name
    case.mkdir(parents=True, exist_ok=True)
    keys.mkdir(parents=True, exist_ok=True)
    known = s.believed if own is None else own.described
    leave_out = own is not None and bool(own.facts.get("keys_left_out"))
    (case / "robot.urdf").write_text(urdf(known))
    (case / "robot.yaml").write_text(robot_yaml(known, s.interface.rate, leave_out))
    trace = simulate(s.body, s.plans, tune(s.rng, s.body, s.plans[0].tick, s.hertz))
    # The best that anyone could predict from the planned motion: the true plant as if it followed the plan.
    perfect = Trace(s.grid, s.t, s.q, s.v, s.a, ideal(s.body, s.q, s.v, s.a, s.t))
    runs = [write_run(s, trace, perfect, copy, case, keys) for copy in range(len(s.plans))]
    sizes = channel_sizes(runs)
    require(s.body.two_mass is None or bool(sizes[s.body.two_mass.joint] > TWO_MASS_SHOWS))
    key = {
        "id": name,
        "robot": s.base.family,
        "level": level,
        "simulation": {"kind": "law"} if own is None else {"kind": own.kind, **own.facts},
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
