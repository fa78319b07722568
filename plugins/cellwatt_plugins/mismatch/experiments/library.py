"""A small library of experiments: motions in which effects that look alike part company."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.experiments.limits import Limits
from cellwatt_plugins.mismatch.experiments.trajectory import Hold, Piece, Trajectory, harmonics, move, replay, through
from cellwatt_plugins.mismatch.input.run import Motion
from cellwatt_plugins.robot.effects.states import States

Float = NDArray[np.float64]

SWEEP = 3.0
"""s of one sweep at constant speed, about."""
REST = 3.0
"""s of one hold."""
WARMING = 600.0
"""s of the cycle that warms the arm."""
STANDING = 300.0
"""s of the long hold."""
PROGRAM = 40.0
"""s of the recorded program that are repeated at most."""
POSES = 400
"""Recorded poses looked at for their load, about."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """A motion with what it does, in words that follow ``Run this:``."""

    name: str
    does: str
    trajectory: Trajectory


def joint_experiments(limits: Limits, states: Sequence[States], joint: int) -> list[Experiment]:
    """Experiments on one joint (0-based) while the others rest."""
    loads = loaded_poses(limits, states, joint)
    who = f"joint {joint + 1}"
    return [
        _of(limits, "speed ladder", f"sweeps {who} both ways at six constant speeds over two decades",
            _ladder(limits, limits.home, joint, np.geomspace(0.01, 1.0, 6))),
        _of(limits, "loaded sweeps", f"sweeps {who} both ways at four speeds in poses with different load on it",
            [p for pose in loads for p in _at(limits, pose, _ladder(limits, pose, joint, np.geomspace(0.02, 0.8, 4)))]),
        _of(limits, "loaded holds", f"goes through poses with different load on {who} and holds each",
            [p for pose in loads for p in (*move(limits.home, pose, limits), Hold(pose, REST),
                                           *move(pose, limits.home, limits))]),
        _of(limits, "slow reversals", f"turns {who} back and forth slowly at one place, over ever longer ways",
            _reversals(limits, limits.home, joint)),
        _of(limits, "loaded reversals", f"turns {who} back and forth slowly in poses with different load on it",
            [p for pose in loads for p in _at(limits, pose, _reversals(limits, pose, joint))]),
        _of(limits, "quick moves", f"moves {who} over one path at three speeds, with rests in which it may ring",
            _quick(limits, joint)),
        _of(limits, "long hold", f"holds the arm still for {STANDING / 60:.0f} min under the greatest load on {who}",
            _at(limits, loads[-1], [Hold(loads[-1], STANDING)])),
    ]  # fmt: skip


def arm_experiments(limits: Limits, states: Sequence[States]) -> list[Experiment]:
    """Experiments with all joints."""
    cycle = "moves all joints together through a 20 s cycle of sines"
    return [
        _of(limits, "excitation", cycle, _excited(limits, 60.0)),
        _of(limits, "warming cycle", f"{cycle}, again and again for {WARMING / 60:.0f} min: start it with a cold arm",
            _excited(limits, WARMING)),
        _of(limits, "wrist orientations", "holds and turns the last joints in several orientations of the flange",
            _orientations(limits)),
        _of(limits, "base sweeps", "turns joint 1 from end to end at two speeds in two postures of the arm",
            _base_sweeps(limits, states)),
        _of(limits, "program again", "repeats what the first recording did: start it as the recording was started",
            _program(limits, states[0], (1.0,))),
        _of(limits, "program at three speeds", "repeats what the first recording did at 100, 60 and 30 % speed",
            _program(limits, states[0], (1.0, 0.6, 0.3))),
    ]  # fmt: skip


def loaded_poses(limits: Limits, states: Sequence[States], joint: int) -> list[Float]:
    """Poses with the least, the middle and the greatest load of gravity on a joint, in order of its size.

    They are recorded ones, and the home pose with one joint at an end of its range.
    """
    every = max(1, sum(len(s.q) for s in states) // POSES)
    poses = [np.concatenate([s.q for s in states])[::every], limits.home[None]]
    for other in range(len(limits.home)):
        poses += [_with(limits.home, other, float(end[other]))[None] for end in (limits.low, limits.high)]
    reachable = np.clip(np.concatenate(poses), limits.low, limits.high)
    load = states[0].arm.body.gravity(reachable)[:, joint]
    chosen = {int(np.argmin(load)), int(np.argmin(np.abs(load))), int(np.argmax(load))}
    return [reachable[i] for i in sorted(chosen, key=lambda i: abs(load[i]))]


def _of(limits: Limits, name: str, does: str, pieces: Sequence[Piece]) -> Experiment:
    """With a rest at home before and after."""
    return Experiment(name, does, Trajectory((Hold(limits.home, 1.0), *pieces, Hold(limits.home, 1.0))))


def _at(limits: Limits, pose: Float, pieces: Sequence[Piece]) -> list[Piece]:
    """Pieces that start and end in a pose, with the way there and back."""
    return [*move(limits.home, pose, limits), Hold(pose, 0.5), *pieces, *move(pose, limits.home, limits)]


def _with(pose: Float, joint: int, value: float) -> Float:
    out = pose.copy()
    out[joint] = value
    return out


def _around(limits: Limits, pose: Float, joint: int, way: float) -> tuple[Float, Float]:
    """Ends of a stretch of ``way`` rad, or what fits, about a pose."""
    low, high = float(limits.low[joint]), float(limits.high[joint])
    half = min(way, high - low) / 2
    middle = float(np.clip(pose[joint], low + half, high - half))
    return _with(pose, joint, middle - half), _with(pose, joint, middle + half)


def _ladder(limits: Limits, pose: Float, joint: int, shares: Float) -> list[Piece]:
    """Both ways at each speed, given as shares of the greatest."""
    out: list[Piece] = []
    for speed in shares * limits.cruise[joint]:
        ramps = 1.6 * speed**2 / limits.ramp[joint]
        start, end = _around(limits, pose, joint, float(SWEEP * speed + ramps))
        out += [*move(pose, start, limits), Hold(start, 0.3), *through([start, end, start], limits, float(speed), 0.3)]
        out += move(start, pose, limits)
    return out


def _reversals(limits: Limits, pose: Float, joint: int) -> list[Piece]:
    out: list[Piece] = []
    for way in (0.005, 0.015, 0.05, 0.15):
        start, end = _around(limits, pose, joint, way)
        out += [*move(pose, start, limits), Hold(start, 0.5)]
        out += [*through([start, end, start, end, start], limits, way / 2, 0.2), *move(start, pose, limits)]
    return out


def _quick(limits: Limits, joint: int) -> list[Piece]:
    start, end = _around(limits, limits.home, joint, 0.8)
    out = list(move(limits.home, start, limits))
    for share in (0.3, 0.6, 1.0):
        out += through([start, end, start, end, start], limits, share * float(limits.cruise[joint]), 0.6)
    return [*out, *move(start, limits.home, limits)]


def _excited(limits: Limits, seconds: float) -> list[Piece]:
    sines = harmonics(limits, seconds)
    return _at(limits, sines.centre, [sines])


def _orientations(limits: Limits) -> list[Piece]:
    """The last three joints (fewer where the arm has fewer) at the ends and in the middle of their ranges."""
    joints = len(limits.home)
    turned = range(max(1, joints - 3), joints)
    poses = [limits.home]
    for joint in turned:
        poses += [_with(poses[-1], joint, float(end[joint])) for end in (limits.low, limits.high)]
        poses.append(_with(poses[-1], joint, float(limits.low[joint] + limits.high[joint]) / 2))
    return [*through(poses, limits, rest=REST / 2), *move(poses[-1], limits.home, limits)]


def _base_sweeps(limits: Limits, states: Sequence[States]) -> list[Piece]:
    loads = loaded_poses(limits, states, min(1, len(limits.home) - 1))
    out: list[Piece] = []
    for pose in (loads[0], loads[-1]):
        start, end = (_with(pose, 0, float(side[0])) for side in (limits.low, limits.high))
        out += [*move(limits.home, start, limits), Hold(start, REST)]
        for share in (0.3, 0.9):
            out += through([start, end, start], limits, share * float(limits.cruise[0]), REST / 2)
        out += move(start, limits.home, limits)
    return out


def _program(limits: Limits, first: States, speeds: Sequence[float]) -> list[Piece]:
    kept = first.time <= first.time[0] + PROGRAM
    motion = Motion(first.time[kept], first.q[kept], first.qd[kept], first.qdd[kept])
    start, end = motion.position[0], motion.position[-1]
    out: list[Piece] = []
    for speed in speeds:
        out += [*move(limits.home, start, limits), Hold(start, 0.5), replay(motion, speed), Hold(end, 0.5)]
        out += move(end, limits.home, limits)
    return out
