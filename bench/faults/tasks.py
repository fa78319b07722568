"""Tasks for an arm: closed loops of moves between rests, drawn at random."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from concealed.arms import Arm, Array

STEP = 0.01


@dataclass(frozen=True)
class Task:
    """Rest poses (M + 1, n) rad, the last one the first; (M,) s of each move at full speed and of the rest after it.

    `shape` is the profile of a move, "jerk" (minimum jerk) or "ramp" (constant acceleration, speed, deceleration);
    `held` first and last move with a part in the gripper, or None.
    """

    poses: Array
    seconds: Array
    rests: Array
    shape: str
    held: tuple[int, int] | None


@dataclass(frozen=True)
class Path:
    """One run of a task on the grid: (N, n) rad and its derivatives, (N,) which move runs (-1 at rest)."""

    q: Array
    v: Array
    a: Array
    move: Array


def draw_task(rng: np.random.Generator, arm: Arm) -> Task:
    """Four to nine moves of one joint or more; some tasks come by the same pose twice, as pick-and-place does."""
    n, count = arm.joints, int(rng.integers(4, 10))
    low, high = arm.low * 0.55, arm.high * 0.55
    poses = [rng.uniform(low, high)]
    while len(poses) < count:
        if len(poses) > 2 and rng.random() < 0.15:
            poses.append(poses[-2].copy())
            continue
        moving = rng.random(n) < 0.4
        moving[int(rng.integers(n))] = True
        way = rng.uniform(0.35, 1.6, n) * rng.choice([-1.0, 1.0], n)
        there = np.where(moving, np.clip(poses[-1] + way, low - 0.4, high + 0.4), poses[-1])
        poses.append(np.where(np.abs(there - poses[-1]) > 0.25, there, poses[-1]))
        if np.abs(poses[-1] - poses[-2]).max() < 0.25:
            poses.pop()
    poses.append(poses[0].copy())
    ways = np.abs(np.diff(poses, axis=0))
    pace = rng.uniform(0.5, 0.8, count)[:, None]
    speedy = np.max(1.9 * ways / (pace * arm.speed), axis=1)
    hard = np.sqrt(np.max(6.0 * ways / (pace * arm.acceleration), axis=1))
    shape = "jerk" if rng.random() < 0.6 else "ramp"
    held = tuple(sorted(rng.choice(count, 2, replace=False).tolist())) if rng.random() < 0.6 else None
    seconds = np.maximum.reduce([speedy, hard, np.full(count, 0.5)])
    return Task(np.array(poses), seconds, rng.uniform(0.2, 0.5, count), shape, held)


def edit(rng: np.random.Generator, task: Task) -> Task:
    """The task with one pose changed in one joint to three that go there or from there, by 0.1 to 0.8 rad."""
    poses = task.poses.copy()
    pose = int(rng.integers(1, len(poses) - 1))
    moving = np.flatnonzero(
        np.maximum(np.abs(poses[pose] - poses[pose - 1]), np.abs(poses[pose + 1] - poses[pose])) > 0.2
    )
    chosen = rng.choice(moving, min(int(rng.choice([1, 1, 2, 3])), len(moving)), replace=False)
    poses[pose, chosen] += rng.uniform(0.1, 0.8, len(chosen)) * rng.choice([-1.0, 1.0], len(chosen))
    return replace(task, poses=poses)


def run(task: Task, speed: float, jitter: Array, pause: tuple[int, float] | None = None) -> Path:
    """A task at a speed; `jitter` (M,) s on its rests, `pause` (move, s) a longer rest after it."""
    parts, moves = [np.repeat(task.poses[:1], 10, axis=0)], [np.full(10, -1)]
    for m, seconds in enumerate(task.seconds / speed):
        t = np.arange(1, max(2, round(seconds / STEP)) + 1) * STEP / seconds
        parts.append(
            task.poses[m] + progress(np.minimum(t, 1.0), task.shape)[:, None] * (task.poses[m + 1] - task.poses[m])
        )
        rest = max(0.12, task.rests[m] / speed + jitter[m]) + (pause[1] if pause and pause[0] == m else 0.0)
        parts.append(np.repeat(task.poses[m + 1][None], round(rest / STEP), axis=0))
        moves += [np.full(len(t), m), np.full(len(parts[-1]), -1)]
    return path_of(np.concatenate(parts), np.concatenate(moves))


def path_of(q: Array, move: Array) -> Path:
    """Positions with their derivatives, smoothed as a servo does (20 ms)."""
    kernel = np.hanning(7)[1:-1]
    kernel = kernel / kernel.sum()
    padded = np.pad(q, ((2, 2), (0, 0)), mode="edge")
    q = np.column_stack([np.convolve(c, kernel, mode="valid") for c in padded.T])
    v = np.gradient(q, STEP, axis=0)
    return Path(q, v, np.gradient(v, STEP, axis=0), move)


def progress(u: Array, shape: str) -> Array:
    """Share of the way 0 … 1 at share u of the time."""
    if shape == "jerk":
        return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    ramp = 0.3
    peak = 1.0 / (1.0 - ramp)
    up = 0.5 * peak * np.minimum(u, ramp) ** 2 / ramp
    flat = peak * np.clip(u - ramp, 0.0, 1.0 - 2.0 * ramp)
    late = np.clip(u - (1.0 - ramp), 0.0, ramp)
    return up + flat + peak * late - 0.5 * peak * late**2 / ramp


def transfer(rng: np.random.Generator, start: Array, end: Array, arm: Arm) -> Path:
    """The move to another task's start, with a rest around it; only the rest where the arm is there already."""
    before, after = rng.uniform(0.4, 1.2), rng.uniform(0.2, 0.6)
    parts = [np.repeat(start[None], round(before / STEP), axis=0)]
    if np.abs(end - start).max() > 0.01:
        seconds = max(0.4, float(np.max(1.9 * np.abs(end - start) / (0.8 * arm.speed))))
        t = np.arange(1, round(seconds / STEP) + 1) * STEP / seconds
        parts.append(start + progress(np.minimum(t, 1.0), "jerk")[:, None] * (end - start))
        parts.append(np.repeat(end[None], round(after / STEP), axis=0))
    q = np.concatenate(parts)
    return path_of(q, np.full(len(q), -1))
