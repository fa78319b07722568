"""Repetitions of the cube in a recording of whole programs: where each is, how fast, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.energy.path import path_speed
from cellwatt_plugins.energy.recordings import Motion
from cellwatt_plugins.energy.repetitions import Repetition
from cellwatt_plugins.energy.rests import rests
from cellwatt_plugins.robot import Arm

Float = NDArray[np.float64]

REST: Final = 0.4
"""s: staying so long is a rest."""
CREEP: Final = 3e-4
"""rad in 0.1 s: a joint at 3 mrad/s is at rest."""
HERE: Final = 5e-3
"""rad: rests with all joints within this of each other are at one pose."""
COUNTS: Final = 3.0
"""s of a rest that count in finding the start pose: who parks for an hour has not made the start pose there."""
NOMINAL: Final = 0.1
"""Share by which a mean speed may miss the speed of the campaign."""
ANOTHER_WAY: Final = 0.03
"""Share by which a repetition's path may be longer or shorter than the others'."""
LATE: Final = 0.01
"""Share of the usual time by which a repetition may differ, beside …"""
SLACK: Final = 0.15
"""… s by which its ends are not known."""


@dataclass(frozen=True)
class Loop:
    """One way from the start pose back to it."""

    first: int
    last: int
    """Samples: the last at rest before, the first at rest after."""
    start: float
    end: float
    """s."""
    mean_speed: float
    """mm/s."""
    speed: float = 0.0
    """mm/s of the campaign; 0 where it is none of them."""
    problem: str = ""
    """Why it cannot be used."""

    @property
    def seconds(self) -> float:
        """Its length."""
        return self.end - self.start


def find_loops(arm: Arm, motion: Motion, speeds: Sequence[float]) -> tuple[list[Loop], list[str]]:
    """All repetitions in their order, each with its speed or its problem; and what else there is to say."""
    found = [rest for rest in rests(motion, CREEP) if _seconds(motion, rest) >= REST]
    stays = _at_start(motion, found)
    if len(stays) < 2:
        return [], ["the arm does not come back to rest where it began: no repetition"]
    loops = [_loop(arm, motion, before, after) for before, after in pairwise(stays)]
    judged = _judged(loops, motion, found, speeds)
    notes = []
    if _moves_after(motion, stays[-1][1]):
        at = float(motion.time[stays[-1][1] - 1])
        notes.append(
            f"what begins at t = {at:.1f} s does not come back to the start: incomplete, or the arm was parked"
        )
    return judged, notes


def _at_start(motion: Motion, stops: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The rests at the pose where the arm rests most often and longest."""
    poses: list[Float] = []
    members: list[list[tuple[int, int]]] = []
    for a, b in stops:
        pose = np.median(motion.position[a:b], axis=0)
        near = next((i for i, other in enumerate(poses) if np.abs(other - pose).max() < HERE), None)
        if near is None:
            poses.append(pose)
            members.append([(a, b)])
        else:
            members[near].append((a, b))
    return max(members, key=lambda m: sum(min(_seconds(motion, rest), COUNTS) for rest in m), default=[])


def _seconds(motion: Motion, rest: tuple[int, int]) -> float:
    return float(motion.time[rest[1] - 1] - motion.time[rest[0]])


def _loop(arm: Arm, motion: Motion, before: tuple[int, int], after: tuple[int, int]) -> Loop:
    first, last = before[1] - 1, after[0]
    part = slice(max(first - 1, 0), last + 2)
    there = Motion(motion.place, motion.time[part], motion.position[part], motion.velocity[part], motion.torque[part])
    start, end = float(motion.time[first]), float(motion.time[last])
    return Loop(first, last, start, end, path_speed(arm, there, Repetition(start, end, 0.0)))


def _judged(
    loops: Sequence[Loop], motion: Motion, stops: Sequence[tuple[int, int]], speeds: Sequence[float]
) -> list[Loop]:
    """Each loop against its neighbours in speed: way, time and speed."""
    length = float(np.median([loop.mean_speed * loop.seconds for loop in loops]))
    named = [_named(loop, length, speeds) for loop in loops]
    usual = {
        speed: float(np.median([loop.seconds for loop in named if loop.speed == speed]))
        for speed in {loop.speed for loop in named if not loop.problem}
    }
    return [_timed(loop, usual, motion, stops) for loop in named]


def _named(loop: Loop, length: float, speeds: Sequence[float]) -> Loop:
    way = loop.mean_speed * loop.seconds
    if abs(way / length - 1) > ANOTHER_WAY:
        return replace(loop, problem=f"its way is {way:.0f} mm instead of {length:.0f} mm: another way, or cut short")
    nearest = min(speeds, key=lambda speed: abs(speed / loop.mean_speed - 1))
    if abs(loop.mean_speed / nearest - 1) > NOMINAL:
        told = ", ".join(f"{speed:g}" for speed in speeds)
        return replace(loop, problem=f"its mean speed is {loop.mean_speed:.0f} mm/s, none of {told}: interrupted?")
    return replace(loop, speed=nearest)


def _timed(loop: Loop, usual: dict[float, float], motion: Motion, stops: Sequence[tuple[int, int]]) -> Loop:
    if gap := _gap(motion.time[loop.first : loop.last + 1], motion.step):
        return replace(loop, problem=f"the arm's samples are missing for {gap:.2f} s")
    if loop.problem:
        stop = _longest_stop(loop, motion, stops)
        return replace(loop, problem=f"{loop.problem}{stop}") if stop and "mean speed" in loop.problem else loop
    expected = usual[loop.speed]
    if abs(loop.seconds - expected) > LATE * expected + SLACK:
        stop = _longest_stop(loop, motion, stops)
        return replace(loop, problem=f"it took {loop.seconds:.1f} s instead of {expected:.1f} s: interrupted{stop}")
    return loop


def _longest_stop(loop: Loop, motion: Motion, stops: Sequence[tuple[int, int]]) -> str:
    inside = [(_seconds(motion, (a, b)), a) for a, b in stops if loop.first < a and b < loop.last]
    if not inside:
        return ""
    stood, at = max(inside)
    return f"; it stood still for {stood:.1f} s from t = {float(motion.time[at]):.1f} s"


def _gap(time: Float, step: float) -> float:
    """The longest hole, s, where there is one; 0 else."""
    longest = float(np.diff(time).max(initial=0.0))
    return longest if longest > 5 * step else 0.0


def _moves_after(motion: Motion, sample: int) -> bool:
    tail = motion.position[sample:]
    return bool(len(tail) and np.abs(tail - motion.position[sample - 1]).max() > 10 * HERE)
