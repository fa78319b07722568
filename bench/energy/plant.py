"""Measures an arm as a campaign does, and knows where every joule went.

Simulated at 1 kHz and averaged to the rates of robot and analyzer. The bus adds up all joints at each instant;
what is negative feeds the electronics by the share ``returned`` and heats the chopper by the rest.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from .arms import Case, Truth, make_arm
from .chain import torques, write_robot

STEP = 1e-3
ANALYZER = 0.1
STRAY_AT = 3.0
"""A, at which stray losses are the share of the copper losses that a case states."""
START = (0.3, -0.9, 1.4, -0.4, 0.5, 0.3)


def write_campaign(case: Case, folder: Path) -> dict:
    """Write robot.yaml, robot.urdf, readings and runs to ``folder``; returns the key (true J and W)."""
    rng = np.random.default_rng([case.seed, 7])
    truth = make_arm(case)
    _write_robot(case, truth, folder)
    fixed = {
        "controller": float(rng.uniform(20, 60)),
        "robot_electronics": float(rng.uniform(25, 35)),
        "brakes": case.brakes * float(rng.uniform(0.9, 1.1)),
    }
    if not case.separate:
        fixed |= {"controller": fixed["controller"] + fixed["robot_electronics"], "robot_electronics": 0.0}
    _write_states(case, fixed, float(rng.uniform(0, 0.6)), rng, folder)
    points = _points(case, rng)
    runs = []
    (folder / "runs").mkdir(exist_ok=True)
    for payload in (0.0, case.payload):
        runs += [_write_run(case, truth, fixed, points, speed, payload, rng, folder / "runs") for speed in case.speeds]
    key = {"fixed": fixed, "torque_gain": truth.gains.tolist(), "returned": case.returned, "runs": runs}
    (folder / "key.json").write_text(json.dumps(key))
    return key


def _write_robot(case: Case, truth: Truth, folder: Path) -> None:
    joints = {
        "torque_constant": truth.constant,
        "rotor_inertia": truth.known_rotor,
        "winding_resistance": truth.known_resistance,
    }
    head = {"robot": case.name, "payload": case.payload, "brakes": case.brakes > 0}
    head |= {"controller_separate": case.separate, "torque_from": "current" if case.current else "sensor"}
    write_robot(folder, truth.known, joints, **head)


def _write_states(case: Case, fixed: dict, hold: float, rng: np.random.Generator, folder: Path) -> None:
    level = 0.0
    for name, more in zip(("controller", "connected", "released"), fixed.values(), strict=True):
        level += more + (hold if name == "released" else 0.0)
        power = level * (1 + case.meter) + rng.normal(0, case.noise, 600)
        pq.write_table(pa.table({"t": 0.05 + ANALYZER * np.arange(600), "power": power}), folder / f"{name}.parquet")


def _points(case: Case, rng: np.random.Generator) -> np.ndarray:
    """Start, four corners, start: (6, n) rad."""
    start = np.array([*START, 0.2][: case.joints])
    reach = np.array([0.5, 0.3, 0.55, 0.4, 0.2, 0.15, 0.1][: case.joints])
    corners = start + reach * rng.uniform(-1, 1, (4, case.joints))
    return np.vstack([start, corners, start])


def _timing(profile: str, s: np.ndarray) -> np.ndarray:
    if profile == "quintic":
        return 10 * s**3 - 15 * s**4 + 6 * s**5
    if profile == "septic":
        return 35 * s**4 - 84 * s**5 + 70 * s**6 - 20 * s**7
    ramp = 0.25
    rate = np.clip(np.minimum(s, 1 - s) / ramp, 0, 1)
    covered = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2)])
    return covered / covered[-1]


def _motion(case: Case, points: np.ndarray, speed: float):
    """One repetition at 1 kHz: position, velocity, acceleration (N, n), its legs limited as drives limit them."""
    parts = []
    for a, b in pairwise(points):
        far = float(np.abs(b - a).max()) * 700 * case.size
        seconds = max(1.875 * far / speed / 1.6, 0.30, np.sqrt(5.8 * np.abs(b - a).max() / 45))
        s = np.linspace(0, 1, round(seconds / STEP) + 1)
        parts.append(a + (b - a) * _timing(case.profile, s)[1:, None])
    q = np.vstack([points[:1], *parts])
    rest = np.tile(points[:1], (2000, 1))
    padded = np.vstack([rest, q, rest])
    qd = np.gradient(padded, STEP, axis=0)
    qdd = np.gradient(qd, STEP, axis=0)
    inside = slice(2000, 2000 + len(q) - 1)
    return padded[inside], qd[inside], qdd[inside]


def _write_run(case, truth, fixed, points, speed, payload, rng, folder) -> dict:
    q, qd, qdd = _motion(case, points, speed)
    torque = torques(truth.links, q, qd, qdd, payload, truth.tool) + truth.rotor * qdd
    torque += truth.coulomb * np.tanh(qd / 0.01) + truth.viscous * qd
    still = torques(truth.links, points[:1], 0 * points[:1], 0 * points[:1], payload, truth.tool)
    parts = _powers(case, truth, torque, qd, payload)
    rest = _powers(case, truth, still, 0 * still, payload)
    level = sum(fixed.values()) + rng.normal(0, case.drift)
    name = f"{speed:g}_{payload:g}kg"
    pause = round(case.rest / STEP)
    tile = [np.repeat(still, pause, 0)] + [torque, np.repeat(still, pause, 0)] * case.repetitions
    joints = {"tau": np.vstack(tile) * truth.gains}
    for key, moving in (("q", q), ("qd", qd)):
        pad = np.repeat(points[:1] if key == "q" else 0 * points[:1], pause, 0)
        joints[key] = np.vstack([pad] + [moving, pad] * case.repetitions)
    supply = np.concatenate(
        [np.full(pause, rest["supply"][0])] + [parts["supply"], np.full(pause, rest["supply"][0])] * case.repetitions
    )
    _write_robot_file(case, joints, rng, folder / f"{name}.robot.parquet")
    offset = _write_analyzer_file(case, supply + level, rng, folder / f"{name}.analyzer.parquet")
    energy = {k: float(v.sum() * STEP) for k, v in parts.items()}
    seconds = len(q) * STEP
    return {
        "run": name,
        "speed": speed,
        "payload": payload,
        "seconds": seconds,
        "total": energy["supply"] + level * seconds,
        "electronics": (fixed["controller"] + fixed["robot_electronics"]) * seconds,
        "brakes": fixed["brakes"] * seconds,
        "mechanical_losses": energy["mechanical"],
        "electrical_losses": energy["electrical"] + (level - sum(fixed.values())) * seconds,
        "regeneration": energy["chopper"],
        "positive_mechanical": energy["positive"],
        "offset": offset,
    }


def _powers(case: Case, truth: Truth, torque: np.ndarray, qd: np.ndarray, payload: float) -> dict[str, np.ndarray]:
    current = torque / truth.constant
    warm = 1 + (case.heating if payload else 0.0)
    copper = truth.resistance * warm * current**2
    share, exponent = case.stray
    stray = share * truth.resistance * STRAY_AT**2 * (np.abs(current) / STRAY_AT) ** exponent
    electrical = (copper + stray + truth.switching * np.abs(current) + truth.iron * qd**2).sum(axis=1)
    mechanical = (torque * qd).sum(axis=1)
    bus = mechanical + electrical
    supply = np.where(bus > 0, bus, case.returned * bus)
    return {
        "mechanical": mechanical,
        "electrical": electrical,
        "positive": np.maximum(torque * qd, 0).sum(axis=1),
        "chopper": supply - bus,
        "supply": supply,
    }


def _write_robot_file(case: Case, joints: dict, rng: np.random.Generator, path: Path) -> None:
    every = round(1 / case.rate / STEP)
    q, qd, tau = (joints[key][::every] for key in ("q", "qd", "tau"))
    noise = 0.002 * np.abs(tau).max(axis=0) * 0.5
    columns = {"t": np.arange(len(q)) / case.rate}
    columns |= {f"q_{i + 1}": q[:, i] + rng.normal(0, 2e-5, len(q)) for i in range(case.joints)}
    columns |= {f"qd_{i + 1}": qd[:, i] + rng.normal(0, 1e-3, len(q)) for i in range(case.joints)}
    columns |= {f"tau_{i + 1}": tau[:, i] + rng.normal(0, noise[i] + 1e-9, len(q)) for i in range(case.joints)}
    pq.write_table(pa.table({k: v.astype(np.float64 if k == "t" else np.float32) for k, v in columns.items()}), path)


def _write_analyzer_file(case: Case, supply: np.ndarray, rng: np.random.Generator, path: Path) -> float:
    """Means over 0.1 s that begin anywhere, on a clock of its own; returns analyzer's time less robot's."""
    each, first = round(ANALYZER / STEP), int(rng.integers(0, 100))
    count = (len(supply) - first) // each
    means = supply[first : first + count * each].reshape(count, each).mean(axis=1) * (1 + case.meter)
    offset = float(rng.uniform(-1, 1))
    time = (first + each * (np.arange(count) + 0.5) - 0.5) * STEP + offset
    pq.write_table(pa.table({"t": time, "power": means + rng.normal(0, case.noise, count)}), path)
    return offset


def production(
    case: Case, fixed: dict, speed: float, payload: float, repetitions: int, pause: float, rate: float, points=None
):
    """A task as it runs in a cell: on a grid of ``rate`` Hz position, velocity, torque as given, power and groups (W).

    Power and groups are means over the grid step; the analyzer's and the encoders' noise are in. Without ``points``
    (k, n) rad the way is that of the campaign.
    """
    truth, rng = make_arm(case), np.random.default_rng([case.seed, 11])
    points = _points_of(case) if points is None else points
    q, qd, qdd = _motion(case, points, speed)
    wait = np.repeat(points[:1], round(pause / STEP), 0)
    q, qd, qdd = (
        np.vstack([w, *([part, w] * repetitions)]) for part, w in ((q, wait), (qd, 0 * wait), (qdd, 0 * wait))
    )
    torque = torques(truth.links, q, qd, qdd, payload, truth.tool) + truth.rotor * qdd
    torque += truth.coulomb * np.tanh(qd / 0.01) + truth.viscous * qd
    groups = _powers(case, truth, torque, qd, payload)
    each = round(1 / rate / STEP)
    count = len(q) // each
    means = {k: v[: count * each].reshape(count, each).mean(axis=1) for k, v in groups.items()}
    power = (means["supply"] + sum(fixed.values())) * (1 + case.meter) + rng.normal(0, case.noise, count)
    samples = {"position": q, "velocity": qd, "torque": torque * truth.gains}
    seen = {k: v[each // 2 :: each][:count] + rng.normal(0, 2e-5, (count, case.joints)) for k, v in samples.items()}
    return seen, power, means


def _points_of(case: Case) -> np.ndarray:
    """The same corners as in the campaign."""
    rng = np.random.default_rng([case.seed, 7])
    rng.uniform(size=4)
    rng.normal(size=1800)
    return _points(case, rng)
