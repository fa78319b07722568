"""Finds the repetitions of the cube path in a recording of whole programs, with the speed and problems of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from cellwatt_plugins.energy.recordings import RobotTrace
from cellwatt_plugins.energy.repetitions import Repetition
from cellwatt_plugins.energy.rests import rests
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.stretches import at_one_pose

REST: Final = 0.4
"""Shortest rest, s."""
CREEP: Final = 3e-4
"""Largest movement of a joint at rest in 0.1 s, rad: 3 mrad/s."""
HERE: Final = 5e-3
"""Largest difference of every joint between rests at one pose, rad."""
COUNTS: Final = 3.0
"""Longest time of a rest that counts when the start pose is sought, s, so that a parked arm does not define it."""
NOMINAL: Final = 0.1
"""Largest relative difference of a mean speed from the campaign's speed."""
ANOTHER_WAY: Final = 0.03
"""Largest relative difference of a repetition's path length from the others'."""
LATE: Final = 0.01
"""Largest relative difference of a repetition's duration from the usual, in addition to …"""
SLACK: Final = 0.15
"""… the uncertainty of its ends, s."""
MISSING: Final = 5.0
"""Shortest hole, in sample intervals, for which a run is refused."""


@dataclass(frozen=True)
class Loop:
    """One repetition, from the start pose back to it, ``start`` to ``end`` s.

    ``first`` is the last sample at rest before it, ``last`` the first at rest after it; ``speed`` is the campaign's
    speed, 0 if none matches, and ``mean_speed`` the measured one, mm/s; ``problem``: why it cannot be used.
    """

    first: int
    last: int
    start: float
    end: float
    mean_speed: float
    speed: float = 0.0
    problem: str = ""

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.end - self.start

    @property
    def way(self) -> float:
        """Length of the path, mm."""
        return self.mean_speed * self.seconds


def find_loops(arm: Arm, motion: RobotTrace, speeds: Sequence[float]) -> tuple[list[Loop], list[str]]:
    """All repetitions in order, each with its speed or problem, and notes on the rest of the recording."""
    found = [rest for rest in rests(motion, CREEP) if _seconds(motion, rest) >= REST]
    # The rests at the pose where the arm rests most often and longest.
    counts = [min(_seconds(motion, rest), COUNTS) for rest in found]
    stays = at_one_pose(motion.position, found, HERE, counts)
    if len(stays) < 2:
        return [], ["the arm does not return to its start pose: no repetition"]
    loops = [_loop(arm, motion, before, after) for before, after in pairwise(stays)]
    ways = [loop.way for loop in loops if loop.way > 0]
    if not ways:
        return [], ["the flange does not move between rests at the start pose: no repetition"]
    length = float(np.median(ways))
    named = [_named(loop, length, speeds) for loop in loops]
    usual = {
        speed: float(np.median([loop.seconds for loop in named if loop.speed == speed]))
        for speed in {loop.speed for loop in named if loop.speed}
    }
    notes, end = [], stays[-1][1]
    if len(tail := motion.position[end:]) and np.abs(tail - motion.position[end - 1]).max() > 10 * HERE:
        at = float(motion.time[end - 1])
        notes = [
            f"the motion from t = {at:.1f} s on does not return to the start pose: incomplete, or the arm was parked"
        ]
    return [_timed(loop, usual, motion) for loop in named], notes


def _seconds(motion: RobotTrace, rest: tuple[int, int]) -> float:
    return float(motion.time[rest[1] - 1] - motion.time[rest[0]])


def _loop(arm: Arm, motion: RobotTrace, before: tuple[int, int], after: tuple[int, int]) -> Loop:
    first, last = before[1] - 1, after[0]
    part = slice(max(first - 1, 0), last + 2)
    there = replace(motion, time=motion.time[part], position=motion.position[part])
    start, end = float(motion.time[first]), float(motion.time[last])
    return Loop(first, last, start, end, Repetition(start, end, 0.0).path_speed(arm, there))


def _named(loop: Loop, length: float, speeds: Sequence[float]) -> Loop:
    """Assign the speed if the path is as long as the others', ``length`` mm; else the problem."""
    if abs(loop.way / length - 1) > ANOTHER_WAY:
        way = f"{loop.way:.0f} mm instead of {length:.0f} mm"
        return replace(loop, problem=f"its path is {way}: another path, or interrupted")
    nearest = min(speeds, key=lambda speed: abs(speed / loop.mean_speed - 1))
    if abs(loop.mean_speed / nearest - 1) > NOMINAL:
        told = ", ".join(f"{speed:g}" for speed in speeds)
        return replace(loop, problem=f"its mean speed is {loop.mean_speed:.0f} mm/s, none of {told}: interrupted?")
    return replace(loop, speed=nearest)


def _timed(loop: Loop, usual: Mapping[float, float], motion: RobotTrace) -> Loop:
    """Assign a problem if the duration differs from others at this speed, or samples are missing."""
    gap, problem = float(np.diff(motion.time[loop.first : loop.last + 1]).max()), loop.problem
    expected = usual.get(loop.speed, loop.seconds)
    if abs(loop.seconds - expected) > LATE * expected + SLACK:
        problem = f"it took {loop.seconds:.1f} s instead of {expected:.1f} s: interrupted"
    if gap > MISSING * motion.step:
        problem = f"the arm's samples are missing for {gap:.2f} s"
    return replace(loop, problem=problem)
