"""An arm of four joints: the truth of these tests, sharing no code with the plugin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from energy.chain import Link, torques, write_robot

from tests.plugins.faults.watching import write_recording

RATE = 100.0
LINKS = (
    Link((0, 0, 0.3), (0, 0, 1), 8.0, (0.01, 0.0, 0.05), (0.0341,) * 3),
    Link((0, 0, 0.1), (0, 1, 0), 7.0, (0.0, 0.02, 0.2), (0.0672,) * 3),
    Link((0, 0, 0.4), (0, 1, 0), 4.0, (0.15, 0.0, 0.02), (0.0216,) * 3),
    Link((0.3, 0, 0), (1, 0, 0), 1.5, (0.06, 0.01, 0.0), (0.0025,) * 3),
)
ROTOR = np.array([1.2, 1.2, 0.6, 0.15])
COULOMB = np.array([7.0, 8.0, 5.0, 2.0])
VISCOUS = np.array([4.0, 5.0, 3.0, 0.8])
CONSTANT = np.array([25.0, 28.0, 20.0, 9.0])
RESISTANCE = np.array([0.7, 0.7, 0.8, 1.6])
STANDBY = 100.0
OFF = 1.05
HOME_A, HOME_B = np.array([0.3, -0.4, 0.5, 0.2]), np.array([-0.5, 0.2, -0.3, -0.4])
TASK_A = ({0: 0.9}, {1: 0.6, 2: -0.7}, {3: 1.1}, {0: -0.7, 2: 0.5}, {0: -0.2, 1: -0.6, 2: 0.2, 3: -1.1})
TASKS = {
    "A": (HOME_A, TASK_A),
    "B": (HOME_B, ({1: -0.5, 3: 0.9}, {0: 0.8}, {2: 0.8, 3: -0.4}, {0: -0.8, 1: 0.5, 2: -0.8, 3: -0.5})),
    "C": (HOME_B, ({0: 0.5}, {2: 0.6, 3: 0.8}, {1: 0.4}, {0: -0.5, 1: -0.4}, {2: -0.6, 3: -0.8})),
    "D": (HOME_A, ({0: 0.9}, {2: -0.7}, {0: -0.5, 2: 0.3}, {0: -0.4, 2: 0.4})),
    "D2": (HOME_A, ({0: 0.7}, {2: -0.8}, {0: -0.5, 2: 0.5}, {0: -0.2, 2: 0.3})),
    "E": (HOME_A, ({0: 0.6}, {1: 0.6, 2: -0.7}, {3: 0.7}, {0: -0.5, 2: 0.5}, {0: -0.1, 1: -0.6, 2: 0.2, 3: -0.7})),
    "F": (HOME_A, ({0: 0.9}, {1: 0.6, 2: -0.7}, {3: 0.8, 2: 0.3}, {0: -0.9, 2: 0.4, 3: -0.8}, {1: -0.6})),
}


@dataclass(frozen=True)
class Fault:
    """``what`` is spring (Nm/rad), friction (share), winding (share), drive_cut, belt_off, encoder_stuck,
    encoder_scale (share) or encoder_offset (rad) on ``joint`` (0-based)."""

    what: str
    joint: int
    size: float = 0.0


@dataclass(frozen=True)
class Cycle:
    """A run of task A, B, D (two joints only) or F (first and last move of one joint), or one never learned: C, D2
    (moves D's joints) or E (begins as A).

    ``pause`` s after its second move, ``part`` kg more from the second to the third, ``warmth`` share of friction more.
    """

    task: str = "A"
    speed: float = 1.0
    pause: float = 0.0
    part: float = 0.0
    warmth: float = 0.0
    faults: tuple[Fault, ...] = ()


@dataclass
class Run:
    """What was measured, and the start and end of each cycle, s."""

    time: np.ndarray
    position: np.ndarray
    power: np.ndarray
    spans: list[tuple[float, float]]


def run(cycles: Sequence[Cycle], seed: int = 0, noise: float = 1.0) -> Run:
    """The cycles one after the other, with a rest and where needed a move between them."""
    random = np.random.default_rng(seed)
    spans, here = [], TASKS[cycles[0].task][0]
    positions, powers = [np.repeat(here[None], 80, axis=0)], [np.full(80, at_rest(here))]
    for cycle in cycles:
        home = TASKS[cycle.task][0]
        if not np.allclose(here, home):
            between = np.concatenate([move(here, home, 0.9), np.repeat(home[None], 40, axis=0)])
            positions.append(between)
            powers.append(supply(between, Cycle(), np.zeros(len(between))))
        path, moves = way(cycle, random)
        start = sum(map(len, positions))
        held = ((moves >= 1) & (moves <= 2)).astype(float)
        powers.append(supply(path, cycle, held))
        positions.append(shown(path, cycle.faults))
        spans.append((start / RATE, (start + len(path)) / RATE))
        rest = int(random.integers(60, 120))
        positions.append(np.repeat(home[None], rest, axis=0))
        powers.append(np.full(rest, at_rest(home)))
        here = home
    position, power = np.concatenate(positions), np.concatenate(powers)
    power = power + noise * random.standard_normal(len(power))
    position = position + noise * 3e-5 * random.standard_normal(position.shape)
    return Run(np.arange(len(power)) / RATE, position, power, spans)


def way(cycle: Cycle, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Path (N, n) rad of a cycle, and which move runs or ran last (N,), -1 before the first."""
    pose, moves_ = TASKS[cycle.task]
    parts, moves = [np.repeat(pose[None], 10, axis=0)], [np.full(10, -1)]
    for number, by in enumerate(moves_):
        target = pose + np.array([by.get(j, 0.0) for j in range(len(pose))])
        seconds = (0.55 + 0.4 * np.abs(target - pose).max()) / cycle.speed
        rest = 0.3 / cycle.speed + 0.02 * random.standard_normal() + (cycle.pause if number == 1 else 0.0)
        parts += [move(pose, target, seconds), np.repeat(target[None], round(rest * RATE), axis=0)]
        moves.append(np.full(len(parts[-1]) + len(parts[-2]), number))
        pose = target
    return np.concatenate(parts), np.concatenate(moves)


def move(start: np.ndarray, end: np.ndarray, seconds: float) -> np.ndarray:
    """A minimum-jerk move."""
    u = np.minimum(np.arange(1, round(seconds * RATE) + 1) / RATE / seconds, 1.0)[:, None]
    return start + u**3 * (10 - 15 * u + 6 * u**2) * (end - start)


def supply(path: np.ndarray, cycle: Cycle, held: np.ndarray) -> np.ndarray:
    """Power (N,) W without noise."""
    still = [f.joint for f in cycle.faults if f.what in ("drive_cut", "belt_off")]
    q = path.copy()
    q[:, still] = q[0, still]
    v = np.gradient(q, 1 / RATE, axis=0)
    friction = (COULOMB * np.tanh(v / 0.004) + VISCOUS * v) * (1 + cycle.warmth)
    torque = links(q, cycle.part * held) + ROTOR * np.gradient(v, 1 / RATE, axis=0) + friction
    resistance = RESISTANCE.copy()
    for fault in cycle.faults:
        j = fault.joint
        if fault.what == "spring":
            torque[:, j] += fault.size * (q[:, j] - q[0, j])
        elif fault.what == "friction":
            torque[:, j] += fault.size * friction[:, j]
        elif fault.what == "winding":
            resistance[j] *= 1 + fault.size
    drives = torque * v + resistance * (torque / CONSTANT) ** 2
    for j in still:
        turning = np.gradient(path[:, j], 1 / RATE)
        share = 0.4 if Fault("belt_off", j) in cycle.faults else 0.0
        drives[:, j] = share * (COULOMB[j] * np.abs(turning) + VISCOUS[j] * turning**2)
    return STANDBY + drives.sum(axis=1)


def at_rest(pose: np.ndarray) -> float:
    """Power W that holds the arm."""
    torque = links(np.repeat(pose[None], 9, axis=0), np.zeros(9))[4]
    return float(STANDBY + np.sum(RESISTANCE * (torque / CONSTANT) ** 2))


def links(q: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Torques (N, 4) Nm of the links and of a part (N,) kg at the flange."""
    v = np.gradient(q, 1 / RATE, axis=0)
    a = np.gradient(v, 1 / RATE, axis=0)
    own, with_a_kilogram = (torques(LINKS, q, v, a, kilograms, (0.12, 0.0, 0.0)) for kilograms in (0.0, 1.0))
    return own + part[:, None] * (with_a_kilogram - own)


def shown(path: np.ndarray, faults: Sequence[Fault]) -> np.ndarray:
    """What the encoders show."""
    out = path.copy()
    for fault in faults:
        j = fault.joint
        if fault.what in ("drive_cut", "belt_off"):
            out[:, j] = path[0, j]
        elif fault.what == "encoder_stuck":
            out[len(path) // 2 :, j] = path[len(path) // 2, j]
        elif fault.what == "encoder_scale":
            out[:, j] = path[0, j] + (1 + fault.size) * (path[:, j] - path[0, j])
        elif fault.what == "encoder_offset":
            out[:, j] += fault.size
    return out


def describe(folder: Path, heavier: float = 1.0) -> Path:
    """Writes ``robot.yaml`` with a URDF; masses, friction and resistances are ``OFF`` the truth.

    An arm that is ``heavier`` by a factor in all of its masses, torques and drives takes as much more power.
    """
    joints = {
        "torque_constant": heavier * CONSTANT,
        "rotor_inertia": heavier * ROTOR,
        "coulomb_friction": heavier * COULOMB / OFF,
        "viscous_friction": heavier * VISCOUS * OFF,
        "winding_resistance": heavier * RESISTANCE * OFF,
    }
    links = [
        replace(link, mass=heavier * OFF * link.mass, inertia=tuple(heavier * i for i in link.inertia))
        for link in LINKS
    ]
    return write_robot(folder, links, joints, robot="points", standby_power=STANDBY + 2.0)


def write_table(path: Path, measured: Run) -> Path:
    """The recording as a table with t, q_1 … q_4 and power."""
    return write_recording(path, measured.time, measured.position, measured.power)
