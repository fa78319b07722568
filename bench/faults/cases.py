"""One cell: healthy cycles to learn from, and cycles to judge with a key of what is wrong or only different in each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path as File

import numpy as np
from concealed.arms import Array, draw_arm, mistune
from concealed.describe import robot_yaml, urdf

from faults.bound import signal_to_noise, signal_to_spread
from faults.plant import ENCODER_FAULTS, JOINT_FAULTS, SIZES, Cell, Fault, draw_cell, measure
from faults.tasks import STEP, Path, Task, draw_task, edit, run, transfer

HARMLESS = ("speed_override", "part_weight", "pause", "warm_up", "new_task")
WARMTH, PART = 0.15, 0.15
"""Shares by which friction of all joints may be higher, and a part heavier or lighter, in healthy cycles."""
OFF_PATH = math.radians(0.4)
"""rad from which an encoder is off its path for certain."""
EDITED = 12
"""Tasks with a changed pose, in a cell that has such."""
FAMILIES = ("industrial6", "collaborative6", "compact6", "light7", "service7")


@dataclass(frozen=True)
class Plan:
    """A cycle to run: task (None: one that was never learned), speed, faults and what is harmless about it."""

    task: int | None
    speed: float
    faults: tuple[Fault, ...] = ()
    harmless: str | None = None


@dataclass(frozen=True)
class Truth:
    """A cycle that was run: its plan, from `start` to `end` s, and by how many watts each fault moved the power."""

    plan: Plan
    start: float
    end: float
    watts: tuple[float, ...]
    moves: int
    first_acts: tuple[int, ...]
    """Move (from 1) in which each fault first moves the power by a tenth of its most, or its encoder off the path."""
    ends: tuple[float, ...]
    """When each move ended, s."""
    signal_to_noise: tuple[float, ...]
    """Of each fault by the end of the move in which it first acts; infinite where an encoder is off by then."""
    signal_to_spread: tuple[float, ...]
    """The same where harmless changes have no bound."""


@dataclass
class Take:
    """A recording under way."""

    q: list[Array] = field(default_factory=list)
    power: list[Array] = field(default_factory=list)
    truths: list[Truth] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Length so far."""
        return STEP * sum(map(len, self.q))


@dataclass(frozen=True)
class Case:
    """Recordings as columns t, q (N, n), power, and the truths of the second; `robot` is the folder of robot.yaml."""

    healthy: tuple[Array, Array, Array]
    judged: tuple[Array, Array, Array]
    truths: tuple[Truth, ...]
    robot: File


def make_case(seed: int, folder: File, cycles: int = 60, calm: bool = False, edited: bool = False) -> Case:
    """A cell drawn by its seed, with no fault at all where it is `calm`; its description is written to `folder`.

    Where it is `edited`, every cycle is that of a known task of which somebody has changed a pose.
    """
    rng = np.random.default_rng(seed)
    arm = draw_arm(rng, FAMILIES[seed % len(FAMILIES)])
    told = mistune(rng, arm, 1.5)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(urdf(told))
    (folder / "robot.yaml").write_text(robot_yaml(told, 1.0 / STEP))
    cell = draw_cell(rng, arm)
    tasks = [draw_task(rng, arm) for _ in range(3)]
    strange = [edit(rng, tasks[k % 3]) for k in range(EDITED)] if edited else [draw_task(rng, arm) for _ in range(2)]
    plans = [Plan(t, s) for t in range(3) for s in (1.0, 1.0, 1.0, 1.0, 1.0, 0.6, 0.6, 0.6, 0.6)]
    healthy = record(rng, cell, tasks, strange, [plans[i] for i in rng.permutation(len(plans))], cold=0.15)
    judged_plans = [Plan(None, 1.0)] * cycles if edited else draw_plans(rng, arm.joints, tasks, cycles, calm)
    judged = record(rng, cell, tasks, strange, judged_plans, cold=0.0)
    return Case(columns(rng, cell, healthy), columns(rng, cell, judged), tuple(judged.truths), folder)


def draw_plans(
    rng: np.random.Generator, joints: int, tasks: Sequence[Task], count: int, calm: bool = False
) -> list[Plan]:
    """Half of the cycles calm – a part of them changed harmlessly –, half with one fault or two."""
    out = []
    for _ in range(count):
        task, speed = int(rng.integers(len(tasks))), float(rng.choice([1.0, 1.0, 0.6]))
        if calm or rng.random() < 0.45:
            harmless = str(rng.choice(HARMLESS)) if rng.random() < 0.5 else None
            out.append(Plan(None if harmless == "new_task" else task, speed, (), harmless))
            continue
        number = 2 if rng.random() < 0.25 else 1
        moving = np.flatnonzero(np.ptp(tasks[task].poses, axis=0) > 0.2)
        chosen = rng.choice(moving, min(number, len(moving)), replace=False)
        out.append(Plan(task, speed, tuple(draw_fault(rng, int(j)) for j in chosen)))
    return out


def draw_fault(rng: np.random.Generator, joint: int) -> Fault:
    """Any fault of a joint, in one of three sizes."""
    what = str(rng.choice(JOINT_FAULTS if rng.random() < 0.62 else ENCODER_FAULTS))
    return Fault(what, joint, SIZES[what][int(rng.integers(3))], float(rng.random()))


def record(
    rng: np.random.Generator,
    cell: Cell,
    tasks: Sequence[Task],
    strange: Sequence[Task],
    plans: Sequence[Plan],
    cold: float,
) -> Take:
    """Run the plans one after the other; friction decays from `cold` share more within minutes."""
    take, here = Take(), tasks[0].poses[0]
    for plan in plans:
        task = strange[int(rng.integers(len(strange)))] if plan.task is None else tasks[plan.task]
        way = transfer(rng, here, task.poses[0], cell.arm)
        nothing = np.zeros(len(way.q), bool)
        q, power = measure(cell, way, nothing, part=0.0, warmth=0.0, faults=())
        take.q.append(q)
        take.power.append(power)
        run_cycle(rng, cell, task, plan, take, cold * np.exp(-take.seconds / 120.0))
        here = task.poses[0]
    return take


def run_cycle(rng: np.random.Generator, cell: Cell, task: Task, plan: Plan, take: Take, warmth: float) -> None:
    """One cycle, appended to the take."""
    speed = plan.speed * (1.0 + 0.04 * rng.choice([-1, 1]) if plan.harmless == "speed_override" else 1.0)
    pause = (int(rng.integers(len(task.seconds))), 2.5) if plan.harmless == "pause" else None
    path = run(task, speed, rng.normal(0.0, 0.012, len(task.seconds)), pause)
    held = holding(task, path)
    part = cell.part + (PART * cell.part * rng.choice([-1, 1]) if plan.harmless == "part_weight" else 0.0)
    warmth += WARMTH if plan.harmless == "warm_up" else 0.0
    start = take.seconds
    measured = partial(measure, cell, path, held)
    q, power = measured(part=part, warmth=warmth, faults=plan.faults)
    alone = [measured(part=part, warmth=warmth, faults=(f,)) for f in plan.faults]
    calm = measured(part=part, warmth=warmth, faults=()) if plan.faults else (q, power)
    effects = [p - calm[1] for _, p in alone]
    acts = tuple(
        first_move(path, f, np.abs(s - calm[0])[:, f.joint], np.abs(effect))
        for f, (s, _), effect in zip(plan.faults, alone, effects, strict=True)
    )
    changes = ((part, warmth + WARMTH), ((1.0 + PART) * part, warmth)) if plan.faults else ()
    harmless = [measured(part=kg, warmth=share, faults=())[1] - calm[1] for kg, share in changes]
    ratios = tuple(
        tuple(
            np.inf if _shown(path, move, s - calm[0]) else of(path, move, effect, harmless, cell.noise)
            for (s, _), move, effect in zip(alone, acts, effects, strict=True)
        )
        for of in (signal_to_noise, signal_to_spread)
    )
    take.q.append(q)
    take.power.append(power)
    ends = tuple(start + STEP * float(np.flatnonzero(path.move == m)[-1]) for m in range(len(task.seconds)))
    watts = tuple(float(np.abs(effect).max()) for effect in effects)
    take.truths.append(Truth(plan, start, take.seconds, watts, len(task.seconds), acts, ends, *ratios))


def first_move(path: Path, fault: Fault, off: Array, watts: Array) -> int:
    """The move, from 1, in which a fault first shows."""
    size = off if fault.kind == "encoder" else watts
    shows = np.flatnonzero((size > 0.1 * size.max()) & (path.move >= 0))
    return int(path.move[shows[0]]) + 1 if len(shows) else 0


def _shown(path: Path, move: int, off: Array) -> bool:
    """Whether encoders are ``off`` (N, n) rad by more than rest poses differ, by the end of a move from 1."""
    return bool(np.abs(off[: np.flatnonzero(path.move == move - 1)[-1] + 1]).max() > OFF_PATH)


def holding(task: Task, path: Path) -> Array:
    """(N,) whether the part is in the gripper."""
    if task.held is None:
        return np.zeros(len(path.q), bool)
    first, last = task.held
    begun = np.maximum.accumulate(path.move)
    return (begun >= first) & (begun <= last)


def columns(rng: np.random.Generator, cell: Cell, take: Take) -> tuple[Array, Array, Array]:
    """Time, encoders and power as measured: with noise, power late or early by the cell's delay."""
    q, power = np.concatenate(take.q), np.concatenate(take.power)
    t = STEP * np.arange(len(q))
    power = np.interp(t - cell.delay, t, power) + rng.normal(0.0, cell.noise, len(t))
    return t, q + rng.normal(0.0, cell.encoder_noise, q.shape), power
