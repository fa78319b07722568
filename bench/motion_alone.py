"""Cases for ``explain`` from motion alone: arms, servos and effects of its own, integrated by a program of its own.

    python bench/motion_alone.py OUT [--cases 12] [--seed 1] [--only NAME,...]

Writes OUT/dev/CASE (arm.xml, three runs) and OUT/keys/CASE (key.json, two runs that nothing is fitted to). The plant
takes mass matrix and gravity from MuJoCo, and nothing from cellwatt; friction, servos and what is wrong are its own.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

Float = NDArray[np.float64]
STEP = 0.002
CREEP = 0.012
"""rad/s within which the plant's friction turns over."""
WINDOW = 2.0
"""s of a roll-out, which is then begun anew."""


@dataclass(frozen=True)
class Table:
    """An arm as numbers, one row a joint: position of the frame, axis, mass, centre, inertia, armature, friction,
    damping, kp, kv, force."""

    rows: tuple[tuple[Any, ...], ...]
    rate: float
    """Hz of commands and log."""
    count: float
    """rad of the encoder."""
    noisy: float = 0.0
    """rad of white noise on it."""
    speed: float = 1.0
    """rad/s of quick moves."""


ARMS = {
    "tiny5": Table(
        (
            ((0, 0, 0.05), "z", 0.12, (0, 0.005, 0.02), 1e-4, 0.02, 0.05, 0.02, 15, 0.5, 2.5),
            ((0, 0, 0.04), "y", 0.15, (0.004, 0, 0.06), 2e-4, 0.02, 0.06, 0.02, 15, 0.5, 2.5),
            ((0, 0, 0.11), "y", 0.13, (0.05, 0, 0), 2e-4, 0.02, 0.05, 0.02, 15, 0.5, 2.5),
            ((0.1, 0, 0), "y", 0.08, (0.03, 0, 0.004), 7e-5, 0.015, 0.04, 0.015, 11, 0.35, 1.8),
            ((0.06, 0, 0), "x", 0.06, (0.02, 0.003, 0), 3e-5, 0.015, 0.04, 0.015, 11, 0.35, 1.8),
        ),
        62.5,
        2 * np.pi / 4096,
        0.0004,
        2.0,
    ),
    "mid6": Table(
        (
            ((0, 0, 0.2), "z", 3.5, (0, 0.02, 0.05), 0.02, 0.35, 1.6, 1.2, 900, 30, 80),
            ((0, 0.05, 0.1), "y", 4.6, (0.01, 0, 0.16), 0.09, 0.4, 2.0, 1.5, 1000, 34, 90),
            ((0, 0, 0.35), "y", 2.4, (0.09, 0.01, 0.02), 0.04, 0.25, 1.3, 0.9, 700, 24, 60),
            ((0.15, 0, 0.05), "x", 1.3, (0.08, 0, 0), 0.01, 0.08, 0.5, 0.3, 260, 9, 20),
            ((0.2, 0, 0), "y", 0.9, (0.03, 0.004, 0), 0.004, 0.06, 0.45, 0.25, 220, 7, 20),
            ((0.07, 0, 0), "x", 0.35, (0.02, 0, 0.006), 0.001, 0.05, 0.3, 0.2, 160, 5, 12),
        ),
        100,
        2e-5,
    ),
    "seven": Table(
        (
            ((0, 0, 0.3), "z", 3.0, (0, -0.03, 0.08), 0.02, 0.3, 1.0, 0.8, 2400, 80, 90),
            ((0, 0, 0.05), "y", 3.1, (0, 0.03, 0.1), 0.03, 0.3, 1.1, 0.8, 2600, 90, 90),
            ((0, 0, 0.25), "z", 2.2, (0.02, 0, 0.07), 0.02, 0.25, 0.9, 0.6, 1800, 60, 70),
            ((0.05, 0, 0.1), "y", 2.0, (-0.03, 0, 0.1), 0.02, 0.25, 0.9, 0.6, 1800, 60, 70),
            ((-0.05, 0, 0.25), "z", 1.4, (0, 0.02, 0.06), 0.01, 0.12, 0.5, 0.3, 800, 26, 25),
            ((0, 0, 0.1), "y", 1.2, (0.04, 0, 0.02), 0.006, 0.1, 0.45, 0.3, 700, 24, 25),
            ((0.08, 0, 0.02), "z", 0.6, (0.01, 0.01, 0.04), 0.002, 0.08, 0.4, 0.2, 450, 15, 15),
        ),
        125,
        1e-5,
    ),
}


@dataclass
class Plant:
    """The real arm: an MJCF for masses alone, and numbers (n,) of joints and servos."""

    xml: str
    coulomb: Float
    viscous: Float
    kp: Float
    kv: Float
    force: Float
    delay: float = 0.0
    dead: Float = field(default_factory=lambda: np.zeros(0))
    gap: Float = field(default_factory=lambda: np.zeros(0))
    """rad of play between drive and link; the encoder is on the link."""
    torque: list[Callable[[Float, Float, Float, float], Float]] = field(default_factory=list)
    """Torques (n,) against the motion of q, qd, the links' load and t."""
    lifting: str | None = None
    """The same MJCF while a part is carried, from 9 s to 21 s."""


def mjcf(name: str, arm: Table, payload: tuple[float, Float] | None = None, gravity: str = "0 0 -9.81") -> str:
    """The arm as a file."""
    text, close = "", ""
    for i, (place, axis, mass, centre, inertia, armature, friction, damping, *_) in enumerate(arm.rows, start=1):
        along = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}[axis]
        text += f'<body name="link_{i}" pos="{_text(place)}"><inertial pos="{_text(centre)}" mass="{mass!r}" '
        text += f'diaginertia="{inertia!r} {inertia!r} {0.8 * inertia!r}"/><joint name="joint_{i}" axis="{along}" '
        text += f'damping="{damping!r}" frictionloss="{friction!r}" armature="{armature!r}"/>\n'
        close += "</body>"
    if payload is not None:
        mass, centre = payload
        text += f'<body name="load" pos="{_text(centre)}"><inertial pos="0 0 0" mass="{mass!r}" '
        text += f'diaginertia="{0.0004 * mass!r} {0.0004 * mass!r} {0.0004 * mass!r}"/></body>'
    drives = "".join(
        f'<position name="drive_{i}" joint="joint_{i}" kp="{row[8]}" kv="{row[9]}" '
        f'forcerange="-{row[10]} {row[10]}"/>\n'
        for i, row in enumerate(arm.rows, start=1)
    )
    return (
        f'<mujoco model="{name}"><compiler angle="radian"/><option timestep="0.001" integrator="implicitfast" '
        f'gravity="{gravity}"><flag contact="disable"/></option><worldbody>\n{text}{close}</worldbody>\n'
        f"<actuator>{drives}</actuator></mujoco>"
    )


def columns(run: Path, name: str, joints: int) -> Float:
    """A quantity (N, n) of a run."""
    table = pq.read_table(run)
    return np.column_stack([table[f"{name}_{j + 1}"].to_numpy() for j in range(joints)]).astype(np.float64)


def rolled(model: Any, run: Path, each: Callable[[Any, Any], None] = lambda model, data: None) -> Float:
    """Root mean square error (n,) rad on a run that tells the truth; ``each`` step may change the model."""
    n, data = model.nv, mujoco.MjData(model)
    time = pq.read_table(run)["t"].to_numpy()
    told, q, qd = (columns(run, name, n) for name in ("command", "true_q", "true_qd"))
    per, steps, off = int(WINDOW / (time[1] - time[0])), max(1, round((time[1] - time[0]) / model.opt.timestep)), []
    for start in range(0, len(time) - per, per):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = q[start], qd[start]
        for i in range(start, start + per):
            data.ctrl[:] = told[i]
            for _ in range(steps):
                each(model, data)
                mujoco.mj_step(model, data)
            off.append(data.qpos - q[i + 1])
    return np.asarray(np.sqrt(np.mean(np.square(off), axis=0)))


def _text(values: Any) -> str:
    return " ".join(repr(float(v)) for v in values)


def off(arm: Table, rng: np.random.Generator) -> Table:
    """The arm with the few per cent by which every real one is off its file."""
    rows = []
    for place, axis, mass, centre, inertia, armature, friction, damping, kp, kv, force in arm.rows:
        scale = rng.normal(1, [0.01, 0.01, 0.01, 0.03, 0.03, 0.015, 0.015])
        mass_, inertia_, armature_, friction_, damping_, kp_, kv_ = np.multiply(
            [mass, inertia, armature, friction, damping, kp, kv], scale
        ).tolist()
        rows.append((place, axis, mass_, centre, inertia_, armature_, friction_, damping_, kp_, kv_, force))
    return replace(arm, rows=tuple(rows))


def commands(arm: Table, kind: str, seconds: float, rng: np.random.Generator) -> tuple[Float, Float]:
    """Times and commands (N, n) of a run: sines, slow sweeps joint by joint, or quick moves between poses."""
    n, time = len(arm.rows), np.arange(round(seconds * arm.rate)) / arm.rate
    middle = np.array([0.0, 0.5, 0.7, *([0.3] * (n - 3))])[:n]
    if kind == "sines":
        out = np.tile(middle, (len(time), 1))
        for j in range(n):
            for f in rng.uniform(0.08, 0.7, 4):
                out[:, j] += rng.uniform(0.1, 0.28) * np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) * min(1, 0.3 / f)
        return time, out
    out = np.empty((len(time), n))
    begin, end, start, length = middle, middle, 0.0, 0.5
    turn = 0
    for i, t in enumerate(time):
        if t >= start + length:
            begin, start = end, t
            if kind == "slow":
                end = begin.copy()
                j = turn % n
                end[j] = middle[j] + (0.5 if (turn // n) % 2 == 0 else -0.5) * rng.uniform(0.6, 1)
                length = abs(end[j] - begin[j]) / rng.uniform(0.05, 0.4) + 0.3
                turn += 1
            elif rng.random() < 0.25:
                length = rng.uniform(0.3, 0.8)
            else:
                end = middle + rng.uniform(-0.8, 0.8, n)
                length = float(np.max(np.abs(end - begin))) * 1.9 / arm.speed / rng.uniform(0.3, 1)
        x = np.clip((t - start) / length, 0, 1)
        out[i] = begin + (end - begin) * x**3 * (10 - 15 * x + 6 * x * x)
    return time, out


def drive(plant: Plant, arm: Table, time: Float, told: Float) -> tuple[Float, Float]:
    """True positions and velocities at ``time``: semi-implicit Euler at 1 ms, friction linearised over a step."""
    models = [mujoco.MjModel.from_xml_string(text) for text in (plant.xml, plant.lifting or plant.xml)]
    n = models[0].nv
    q, v, mass = told[0].copy(), np.zeros(n), np.zeros((n, n))
    per = round(1 / arm.rate / STEP)
    late = round(plant.delay / STEP)
    q_out, v_out = np.empty_like(told), np.empty_like(told)
    every = np.repeat(told, per, axis=0)
    every = np.concatenate([np.tile(every[:1], (late, 1)), every])[: len(every)] if late else every
    dead, gap = (each if len(each) else np.zeros(n) for each in (plant.dead, plant.gap))
    loose = np.flatnonzero(gap > 0)
    rotor, speed, inertia = told[0, loose].copy(), np.zeros(len(loose)), models[0].dof_armature[loose].copy()
    for model in models:
        model.dof_frictionloss[:] = model.dof_damping[:] = model.dof_armature[loose] = 0.0
    each_data = [mujoco.MjData(model) for model in models]
    for k in range(len(every)):
        model, data = ((models, each_data)[i][int(9 < k * STEP < 21)] for i in (0, 1))
        data.qpos[:], data.qvel[:] = q, v
        if k % per == 0:
            q_out[k // per], v_out[k // per] = q, v
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fullM(model, data, mass)
        error = every[k] - q
        error = np.sign(error) * np.maximum(np.abs(error) - dead, 0)
        given = np.clip(plant.kp * error - plant.kv * v, -plant.force, plant.force)
        sign = np.tanh(v / CREEP)
        against = plant.coulomb * sign + plant.viscous * v
        load = data.qfrc_bias.copy()
        for each in plant.torque:
            against = against + each(q, v, load, k * STEP)
        stiff = plant.coulomb / CREEP * (1 - sign**2)
        if len(loose):
            own = mass[loose, loose]
            spring, damper = own * (2 * np.pi * 18) ** 2, 2 * 0.3 * own * 2 * np.pi * 18
            apart = rotor - q[loose]
            pressed = apart - np.clip(apart, -gap[loose] / 2, gap[loose] / 2)
            through = spring * pressed + damper * (speed - v[loose]) * (pressed != 0)
            turns = np.tanh(speed / CREEP)
            rubs = plant.coulomb[loose] * turns + plant.viscous[loose] * speed
            slope = plant.coulomb[loose] / CREEP * (1 - turns**2)
            speed = speed + STEP * (given[loose] - rubs - through) / (inertia + STEP * slope)
            rotor = rotor + STEP * speed
            given[loose], against[loose], stiff[loose] = through, 0.0, 0.0
        v = v + np.linalg.solve(mass + STEP * np.diag(stiff), STEP * (given - against - load))
        q = q + STEP * v
    return q_out, v_out


def write(
    folder: Path, key: Path, name: str, arm: Table, plant: Plant, facts: dict[str, Any], seed: int, blind: bool
) -> None:
    """One case."""
    folder.mkdir(parents=True, exist_ok=True)
    key.mkdir(parents=True, exist_ok=True)
    kinds = ("sines", "slow", "quick", "sines", "quick")
    for i, kind in enumerate(kinds[:3] if blind else kinds, start=1):
        rng = np.random.default_rng([seed, i])
        time, told = commands(arm, kind, 20.0 if i > 3 else 36.0 if i == 1 else 30.0, rng)
        q, v = drive(plant, arm, time, told)
        seen = np.round((q + rng.normal(0, arm.noisy, q.shape)) / arm.count) * arm.count
        columns = {"t": time}
        for j in range(q.shape[1]):
            columns |= {f"command_{j + 1}": told[:, j], f"q_{j + 1}": seen[:, j]}
        if i <= 3:
            pq.write_table(pa.table(columns), folder / f"run_{i:02d}.recording.parquet")
            continue
        for j in range(q.shape[1]):
            columns |= {f"true_q_{j + 1}": q[:, j], f"true_qd_{j + 1}": v[:, j]}
        pq.write_table(pa.table(columns), key / f"holdout_{i:02d}.parquet")
    (key / "key.json").write_text(
        json.dumps({"id": folder.name, "robot": name, "count": arm.count, "allowed": []} | facts)
    )


def case(name: str, what: list[str], seed: int) -> tuple[Table, Plant, dict[str, Any], str]:
    """The arm as its user has it, the plant, the key, and the user's file."""
    rng = np.random.default_rng(seed)
    user, n = ARMS[name], len(ARMS[name].rows)
    required: list[dict[str, Any]] = []
    rows, load, gravity, delay, dead = [list(r) for r in off(user, rng).rows], None, "0 0 -9.81", 0.0, np.zeros(n)
    gap, lifted = np.zeros(n), None
    lacks: dict[int, list[int]] = {}
    torque: list[Callable[..., Float]] = []
    for effect in what:
        taken = {r["joint"] for r in required}
        joint = int(rng.choice([j for j in range(n) if j + 1 not in taken]))
        friction, size = user.rows[joint][6], user.rows[joint][10]
        e, at = np.eye(n)[joint], joint + 1
        match effect:
            case "payload":
                mass = float(rng.uniform(0.08, 0.14) * sum(r[2] for r in user.rows))
                load, at = (mass, rng.uniform(0.01, 0.07, 3) * (0.5 if name == "tiny5" else 1)), None
            case "gravity_tilt":
                gravity, at = _text(9.81 * np.array([np.sin(0.06), -np.sin(0.07), -np.cos(0.09)])), None
            case "time_delay":
                delay, at = float(rng.uniform(0.018, 0.04)), None
            case "coulomb_friction":
                lacks.setdefault(joint, []).append(6)
            case "rotor_inertia":
                lacks.setdefault(joint, []).append(5)
            case "drive_gain":
                rows[joint][8] *= float(rng.choice([0.72, 0.78, 1.3]))
            case "drive_dead_band":
                dead[joint] = float(rng.uniform(1.2, 2) * friction / user.rows[joint][8] + 1.5 * user.count)
            case "backlash":
                joint = int(rng.choice([1, 2]))
                gap[joint], at = float(rng.uniform(0.008, 0.016)), joint + 1
            case "torque_saturation":
                rows[joint][10] = 0.0
            case "stribeck_friction":
                torque.append(
                    lambda q, v, load, t, e=e, f=friction: e * 1.3 * f * np.exp(-((v / 0.15) ** 2)) * np.tanh(v / CREEP)
                )
            case "load_dependent_friction":
                joint = int(rng.choice([1, 2]))
                e, at = np.eye(n)[joint], joint + 1
                torque.append(lambda q, v, load, t, e=e: e * 0.2 * np.abs(load) * np.tanh(v / CREEP))
            case "spring_load":
                k = 0.15 * size
                torque.append(lambda q, v, load, t, e=e, k=k: e * k * (q - 0.3))
            case "position_periodic_torque":
                torque.append(lambda q, v, load, t, e=e, f=friction: e * 0.9 * f * np.sin(9 * q + 1))
            case "asymmetric_friction":
                torque.append(
                    lambda q, v, load, t, e=e, f=friction: e * 0.7 * f * np.where(v > 0, 1, 0) * np.tanh(v / CREEP)
                )
            case "nonlinear_viscous_friction":
                c = 1.5 * friction / user.speed**3
                torque.append(lambda q, v, load, t, e=e, c=c: e * c * v**3)
            case "payload_change":
                lifted, at = (0.12 * sum(r[2] for r in user.rows), np.array([0.04, 0.01, 0.02])), None
            case "external_contact":
                torque.append(lambda q, v, load, t, e=e, s=size: e * 0.25 * s * np.exp(-0.5 * ((t - 33.0) / 0.2) ** 2))
            case "unknown":
                other = (joint + 1) % n
                torque.append(
                    lambda q, v, load, t, e=e, o=other, f=friction: e * 2.0 * f * np.sin(3 * q[o]) * np.tanh(3 * v[o])
                )
        required.append({"effect": effect, "joint": at})
    true = replace(user, rows=tuple(map(tuple, rows)))
    stated = [list(r) for r in user.rows]
    for joint, places in lacks.items():
        for place in places:
            stated[joint][place] = 0.0
    plant = Plant(
        mjcf(name, true, load, gravity),
        *(np.array([float(r[i]) for r in rows]) for i in (6, 7, 8, 9, 10)),
        delay=delay,
        dead=dead,
        gap=gap,
        torque=torque,
        lifting=None if lifted is None else mjcf(name, true, lifted, gravity),
    )
    for r in required:
        if r["effect"] == "torque_saturation":
            plant.force[r["joint"] - 1] = _limit(plant, user, r["joint"] - 1, seed)
    return user, plant, {"required": required}, mjcf(name, replace(user, rows=tuple(map(tuple, stated))))


def _limit(plant: Plant, arm: Table, joint: int, seed: int) -> float:
    """A force that the joint's drive reaches now and then."""
    free = replace(plant, force=np.full(len(plant.kp), 1e9))
    time, told = commands(arm, "quick", 12.0, np.random.default_rng([seed, 3]))
    q, v = drive(free, arm, time, told)
    between = told[:-1] - 0.5 * (q[1:] + q[:-1])  # A command holds while the joint moves on.
    return float(np.quantile(np.abs(plant.kp * between - plant.kv * v[:-1])[:, joint], 0.93))


LEVELS = ("null", "single", "pair", "triple", "unknown", "pair", "single", "triple", "beside unknown", "pair")
"""In turn, for each arm."""
EFFECTS = (  # A lack of viscous friction is no more than a servo's damping may be off by.
    *("payload", "coulomb_friction", "drive_gain", "stribeck_friction", "drive_dead_band", "time_delay"),
    *("torque_saturation", "gravity_tilt", "spring_load", "rotor_inertia", "backlash"),
    *("position_periodic_torque", "load_dependent_friction", "external_contact", "asymmetric_friction"),
    *("nonlinear_viscous_friction", "payload_change"),
)


def drawn(level: str, seed: int) -> list[str]:
    """What is wrong with an arm."""
    rng, count = np.random.default_rng([seed, 99]), {"single": 1, "pair": 2, "triple": 3, "beside unknown": 1}
    several = rng.choice(EFFECTS, count.get(level, 0), replace=False).tolist()
    return [*several, "unknown"] if "unknown" in level else several


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--arms", default=",".join(ARMS))
    parser.add_argument("--cases", type=int, default=len(LEVELS))
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--blind", action="store_true", help="leave out the runs that nothing is fitted to")
    given = parser.parse_args()
    for a, name in enumerate(given.arms.split(",")):
        for i in range(given.cases):
            label = f"{name}-{i:02d}"
            if given.only and label not in given.only.split(","):
                continue
            seed = given.seed * 1000 + 100 * a + i
            level = LEVELS[i % len(LEVELS)]
            arm, plant, facts, xml = case(name, drawn(level, seed), seed)
            facts["level"] = "unknown" if "unknown" in level else level
            folder = given.out / "dev" / label
            write(folder, given.out / "keys" / label, name, arm, plant, facts, seed, given.blind)
            (folder / "arm.xml").write_text(xml)
            print(label, facts["required"], flush=True)


if __name__ == "__main__":
    main()
