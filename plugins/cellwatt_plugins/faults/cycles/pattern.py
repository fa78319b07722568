"""Pattern of a healthy cycle, and the time map that aligns any cycle with it.

Time is warped move by move along the path of the encoders, so that a pause, a speed override or a slow start of a move
does not appear as a difference of power.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import ConfigDict, Field, GetPydanticSchema
from pydantic_core.core_schema import no_info_after_validator_function

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.robot.motion import rates
from cellwatt_plugins.robot.samples import interpolated

MARGIN = 0.1
"""Time by which a pattern extends beyond its first and last move, s."""
POSE = math.radians(0.4)
"""Largest distance of a joint from a rest pose of the pattern, rad …"""
REPEAT = 8.0
"""… or, if larger, in standard deviations of the healthy rest pose."""
WAY = math.radians(2.0)
"""Smallest displacement, rad, with which a joint gives the timing of a move."""
LEVELS = np.linspace(0.08, 0.92, 15)
"""Shares of a move's path at which its timing is measured."""
CREEP = 0.01
"""Speed below which the arm is at rest, rad/s, so that encoder noise adds no path."""
SMOOTH = 0.05
"""Positions are averaged over this time before the path is measured, s."""


def _columns(by_joint: Mapping[int, tuple[float, ...]]) -> Float:
    """Convert columns by joint (1-based) to an array (T, n)."""
    if sorted(by_joint) != list(range(1, len(by_joint) + 1)) or len({*map(len, by_joint.values())}) != 1:
        raise ValueError("position must have every joint, all of the same length")
    return np.column_stack([by_joint[joint] for joint in range(1, len(by_joint) + 1)])


def _read(convert: Callable[[Any], Float], kind: Any) -> GetPydanticSchema:
    """An array that is stored in a file as a ``kind``."""
    return GetPydanticSchema(lambda _, schema: no_info_after_validator_function(convert, schema(kind)))


_Row = Annotated[Float, _read(np.array, tuple[float, ...])]
_Columns = Annotated[Float, _read(_columns, dict[int, tuple[float, ...]])]


@dataclass(frozen=True)
class Pattern:
    """One task at one speed, averaged over healthy cycles, as stored in the reference file.

    ``step`` s; ``position`` (T, n) rad and ``power`` (T,) W from ``MARGIN`` before the first move, with ``spread`` (T,)
    W, the standard deviation over ``cycles`` cycles; ``moves``: start and end, s from the first sample; ``repeat`` (n,)
    rad, the standard deviation of rest poses over cycles.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    task: str
    speed: float
    cycles: Annotated[int, Field(ge=1)]
    step: Annotated[float, Field(gt=0)]
    moves: Annotated[tuple[tuple[float, float], ...], Field(min_length=1)]
    repeat: _Row
    power: _Row
    spread: _Row
    position: _Columns

    def __post_init__(self) -> None:
        if not len(self.power) == len(self.spread) == len(self.position) > 1:
            raise ValueError("power, spread and every position must have the same length, at least 2")
        if len(self.repeat) != self.position.shape[1]:
            raise ValueError("position and repeat must have every joint")
        edges = [edge for move in self.moves for edge in move]
        if sorted(edges) != edges or edges[0] < 0 or edges[-1] > self.step * len(self.power):
            raise ValueError("moves must follow each other within the cycle")

    @cached_property
    def time(self) -> Float:
        """Time (T,) of the samples, s from the first."""
        return np.asarray(self.step * np.arange(len(self.power)), np.float64)

    @cached_property
    def rates(self) -> tuple[Float, Float]:
        """Velocity and acceleration (T, n) at the pattern's pace, rad/s and rad/s²."""
        return rates(self.position, self.step)[1:]

    @cached_property
    def slope(self) -> Float:
        """Derivative (T,) W/s of the power."""
        return np.gradient(self.power, self.step)

    @cached_property
    def poses(self) -> tuple[Float, Float]:
        """Rest poses (M, n) rad before and after each move."""
        starts = np.array([start for start, _ in self.moves])
        ends = np.array([end for _, end in self.moves])
        return self.position_at(starts - 0.02), self.position_at(ends + 0.02)

    @cached_property
    def limits(self) -> Float:
        """Largest distance (n,) rad of each joint from a rest pose."""
        return np.asarray(np.maximum(POSE, REPEAT * self.repeat))

    @cached_property
    def ways(self) -> Float:
        """Range (M, n) rad of each joint's angle in each move."""
        return np.stack([np.ptp(self.position[self.part(m)], axis=0) for m in range(len(self.moves))])

    def scaled(self, by: Float) -> Pattern:
        """The pattern with the positions of each joint multiplied by ``by`` (n,)."""
        return replace(self, position=self.position * by, repeat=self.repeat * by)

    def part(self, move: int) -> slice:
        """Slice of the samples of a move."""
        start, end = self.moves[move]
        return slice(max(0, round(start / self.step)), round(end / self.step) + 1)

    def passing(self, move: int, joints: tuple[int, ...]) -> Float:
        """Times in s at which ``joints`` (0-based) have covered each of ``LEVELS`` of a move's path."""
        if (move, joints) not in self._passings:
            part = self.part(move)
            way = _passing(self.time[part], self.position[part][:, list(joints)], self.step)
            self._passings[move, joints] = way
        return self._passings[move, joints]

    @cached_property
    def _passings(self) -> dict[tuple[int, tuple[int, ...]], Float]:
        return {}

    def position_at(self, tau: Float) -> Float:
        """Position (k, n) rad at times tau (k,) s of the pattern."""
        return interpolated(tau, self.time, self.position)


@dataclass(frozen=True)
class Warp:
    """Time map: pattern times ``tau`` (K,) s and recording times ``t`` (K,) s, both rising."""

    tau: Float
    t: Float

    def to_pattern(self, t: Float) -> Float:
        """Pattern times of recording times; at a pace of 1 before and after the moves."""
        inside = np.interp(t, self.t, self.tau)
        return np.asarray(inside + np.minimum(t - self.t[0], 0.0) + np.maximum(t - self.t[-1], 0.0))

    def to_recording(self, tau: Float) -> Float:
        """Recording times of pattern times."""
        inside = np.interp(tau, self.tau, self.t)
        return np.asarray(inside + np.minimum(tau - self.tau[0], 0.0) + np.maximum(tau - self.tau[-1], 0.0))

    def pace(self, t: Float) -> Float:
        """Pattern seconds per second of the recording, at times t (k,) s."""
        slope = np.diff(self.tau) / np.diff(self.t)
        part = np.clip(np.searchsorted(self.t, t) - 1, 0, len(slope) - 1)
        return np.asarray(np.where((t < self.t[0]) | (t > self.t[-1]), 1.0, slope[part]))


@dataclass(frozen=True, slots=True)
class Timing:
    """Timing of a move of the pattern in a recording: ``start`` to ``end`` s, fitted with ``error`` s."""

    start: float
    end: float
    error: float


def timing(pattern: Pattern, move: int, recording: Recording, span: tuple[int, int], joints: Sequence[int]) -> Timing:
    """Align a move of the pattern with the samples ``span`` of the recording, by the path of ``joints`` (0-based)."""
    margin = round(MARGIN / recording.step)
    seen = slice(max(0, span[0] - margin), span[1] + margin + 1)
    own = _passing(recording.time[seen], recording.position[seen][:, list(joints)], recording.step)
    model = pattern.passing(move, tuple(joints))
    middle = model - model.mean()
    slope = float(middle @ own / (middle @ middle))
    offset = float(own.mean() - slope * model.mean())
    error = float(np.abs(own - offset - slope * model).max())
    start, end = pattern.moves[move]
    return Timing(offset + slope * start, offset + slope * end, error)


def warp_of(pattern: Pattern, timings: Sequence[tuple[int, Timing]]) -> Warp:
    """The time map from the moves with known timing: (move, timing), in order."""
    tau = np.array([edge for move, _ in timings for edge in pattern.moves[move]])
    t = np.array([edge for _, found in timings for edge in (found.start, found.end)])
    rising = np.concatenate([[True], np.diff(t) > 1e-3])
    return Warp(tau[rising], t[rising])


def _passing(time: Float, position: Float, step: float) -> Float:
    """Times in s at which each of ``LEVELS`` of the path has been covered."""
    width = max(1, round(SMOOTH / step))
    kernel = np.ones(width) / width
    padded = np.pad(position, ((width // 2, width - 1 - width // 2), (0, 0)), mode="edge")
    smooth = np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])
    pieces = np.linalg.norm(np.diff(smooth, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.where(pieces > CREEP * step, pieces, 0.0))])
    return np.asarray(np.interp(LEVELS * way[-1], way, time))
