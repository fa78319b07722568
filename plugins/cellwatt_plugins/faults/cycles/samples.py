"""A cycle aligned with its healthy pattern: residual of the power, and the harmless variation of healthy cycles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.arm import Mechanics, Motion
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.cycles.load import Load, load_of
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import MARGIN, Pattern
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.noise import white_noise
from cellwatt_plugins.robot.meter.model import Meter, Readings
from cellwatt_plugins.robot.samples import interpolated

STEP = 0.04
"""Time over which power is averaged, s."""
SHIFT = 0.004
"""Time by which a move's power may lead or lag its encoders, s (one sigma) …"""
UNSEEN_SHIFT = 0.05
"""… and for a move that no encoder shows."""
SHARE = 0.01
"""Variation of a move's power between healthy cycles, as a share (one sigma)."""
LEVEL, LEVEL_BARE = 2.0, 10.0
"""Variation of the supply's standing power, W (one sigma), of an arm with and without a description."""
DOUBT = 2.0
"""Factor on the standard deviations of the model's parameters."""
STANDING = 0.5
"""Pace below which the arm pauses; samples in a pause are not used."""


@dataclass(frozen=True)
class Samples:
    """N points of a cycle.

    ``time`` s, ``tau`` s of the pattern, ``residual`` W from healthy power, ``sigma`` W its noise, ``harmless`` (N, h)
    W the variation of healthy cycles (one sigma per column), ``healthy`` the load of the healthy path at this pace,
    ``unmodelled`` (N,) W healthy power minus that of the fitted arm, as of a gripped part. ``group``: number of
    consecutive points whose mean is one value of a slow meter; 1 otherwise.
    """

    time: Float
    tau: Float
    residual: Float
    sigma: Float
    harmless: Float
    healthy: Load
    unmodelled: Float
    group: int


def sample(
    recording: Recording, match: Match, pattern: Pattern, arm: FittedArm, since: float, until: float
) -> Samples | None:
    """The points of one cycle between two pattern times, s, without pauses and moves broken by a stop.

    None if no value of the meter covers this cycle alone.
    """
    time, watts, group = _measured(recording, match, pattern, since, until)
    if len(time) < 2:
        return None
    tau, pace = match.warp.to_pattern(time), match.warp.pace(time)
    healthy = load_of(arm.body, arm.parameters, _motion(arm.body, pattern, tau, pace))
    usual = load_of(arm.body, arm.parameters, _motion(arm.body, pattern, tau, np.ones_like(pace)))
    faster = healthy.power - usual.power
    unsure = DOUBT * (healthy.slope(arm.parameters) - usual.slope(arm.parameters)) @ arm.deviations
    expected = np.interp(tau, pattern.time, pattern.power) + faster
    noise = max(0.05, float(white_noise(watts)[0]) if group == 1 else float(np.quantile(pattern.spread, 0.2)))
    spread = np.interp(tau, pattern.time, _spread(pattern))
    slope = np.gradient(expected, time) if group == 1 else pace * np.interp(tau, pattern.time, pattern.slope)
    late = 0.0 if recording.meter is None else recording.meter.late_spread
    shared = _variation(match, pattern, tau, expected, slope, float(np.hypot(SHIFT, late)))
    harmless = np.column_stack([np.full(len(tau), LEVEL_BARE if arm.bare else LEVEL), shared, 0.1 * faster, unsure])
    sigma = np.sqrt(noise**2 + spread**2)
    return Samples(time, tau, watts - expected, sigma, harmless, healthy, expected - healthy.power, group)


def inside_moves(pattern: Pattern, tau: Float, margin: float) -> NDArray[np.bool_]:
    """True for pattern times (N,) within a move or less than ``margin`` s from it."""
    inside = np.zeros(len(tau), dtype=bool)
    for start, end in pattern.moves:
        inside |= (tau > start - margin) & (tau < end + margin)
    return inside


def _measured(
    recording: Recording, match: Match, pattern: Pattern, since: float, until: float
) -> tuple[Float, Float, int]:
    """Times and power of the points of the cycle, and the number of points per measured value."""
    begin, end = float(match.warp.t[0] - MARGIN), float(match.warp.t[-1] + MARGIN)
    if recording.meter is not None and recording.readings is not None:
        time, watts, group = _within_readings(recording.meter, recording.readings, begin, end)
    else:
        time, watts, group = *_means(recording, begin, end), 1
    usable = _usable(match, pattern, time, since, until) & ~np.isnan(watts)
    usable = np.repeat(usable.reshape(-1, group).all(axis=1), group)
    return time[usable], watts[usable], group


def _within_readings(meter: Meter, readings: Readings, begin: float, end: float) -> tuple[Float, Float, int]:
    """Evenly spaced points within the window of each value of a slow meter."""
    windows = meter.windows(readings)
    inside = (windows.start >= begin) & (windows.end <= end)
    group = max(2, round(meter.window / STEP))
    share = (np.arange(group) + 0.5) / group
    time = windows.start[inside, None] + meter.window * share
    return time.ravel(), np.repeat(readings.value[inside], group), group


def _means(recording: Recording, begin: float, end: float) -> tuple[Float, Float]:
    """Times and mean power of each span of ``STEP`` s."""
    first, last = np.searchsorted(recording.time, [begin, end])
    width = max(1, round(STEP / recording.step))
    count = (last - first) // width
    rows = slice(int(first), int(first + count * width))
    time = recording.time[rows].reshape(count, width).mean(axis=1)
    return time, recording.power[rows].reshape(count, width).mean(axis=1)


def _usable(match: Match, pattern: Pattern, time: Float, since: float, until: float) -> NDArray[np.bool_]:
    """True for points outside pauses and interrupted moves, where power can be compared."""
    tau = match.warp.to_pattern(time)
    usable = (tau > since) & (tau < until) & ((match.warp.pace(time) > STANDING) | inside_moves(pattern, tau, MARGIN))
    for move in match.broken:
        start, end = pattern.moves[move]
        usable &= (tau < start) | (tau > end)
    return np.asarray(usable)


def _motion(body: Mechanics, pattern: Pattern, tau: Float, pace: Float) -> Motion:
    """The healthy motion at the pace of a cycle."""
    velocity, acceleration = (interpolated(tau, pattern.time, rate) for rate in pattern.rates)
    return Motion.of(body, pattern.position_at(tau), velocity * pace[:, None], acceleration * pace[:, None] ** 2)


def _spread(pattern: Pattern) -> Float:
    """Standard deviation (T,) W of a healthy cycle about the pattern beyond its noise, and of the pattern's mean."""
    width = 9
    padded = np.pad(pattern.spread**2, width // 2, mode="edge")
    variance = np.convolve(padded, np.ones(width) / width, mode="valid")
    noise = np.quantile(variance, 0.2)
    return np.asarray(np.sqrt(np.maximum(variance - noise, 0.0) + variance / pattern.cycles))


def _variation(match: Match, pattern: Pattern, tau: Float, expected: Float, slope: Float, shift: float) -> Float:
    """Columns (N, h) W, one sigma each: timing and power of each move."""
    resting = expected[~inside_moves(pattern, tau, 0.0)]
    level = float(np.median(resting)) if len(resting) else float(expected.min())
    columns = []
    for move, (start, end) in enumerate(pattern.moves):
        here = (tau >= start - MARGIN) & (tau <= end + MARGIN)
        columns.append(np.where(here, slope * (UNSEEN_SHIFT if move in match.unseen else shift), 0.0))
        columns.append(np.where(here, SHARE * (expected - level), 0.0))
    return np.column_stack(columns)
