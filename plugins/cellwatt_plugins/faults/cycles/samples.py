"""A cycle laid over its healthy pattern: power that was expected, what differs, and what may differ harmlessly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.cycles.arm import Motion
from cellwatt_plugins.faults.cycles.identify import Arm
from cellwatt_plugins.faults.cycles.load import Load, load_of
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import MARGIN, Pattern
from cellwatt_plugins.faults.cycles.recording import Recording

Float = NDArray[np.float64]

STEP = 0.04
"""Power is averaged over this before it is judged, s."""
SHIFT = 0.004
"""s by which a move's power may lead or lag its encoders (one sigma) …"""
UNSEEN_SHIFT = 0.05
"""… and a move that no encoder shows."""
SHARE = 0.01
"""Share of a move's power by which healthy cycles may differ (one sigma)."""
LEVEL = 2.0
"""W by which the supply's standing power may differ (one sigma)."""
DOUBT = 2.0
"""The model may be wrong by so many standard deviations of its parameters."""
STANDING = 0.5
"""Pace below which the arm pauses: no more is learned from it."""


@dataclass(frozen=True)
class Samples:
    """N points of a cycle.

    ``time`` s, ``tau`` s of the pattern, ``residual`` W against healthy power, ``sigma`` W its noise, ``harmless``
    (N, h) W what may differ in healthy cycles (one sigma each), ``healthy`` the load of the healthy path at this pace,
    ``unmodelled`` (N,) W what healthy power has more than the fitted arm says, as of a part that is held on the way.
    """

    time: Float
    tau: Float
    residual: Float
    sigma: Float
    harmless: Float
    healthy: Load
    unmodelled: Float


def sample(recording: Recording, match: Match, pattern: Pattern, arm: Arm, until: float) -> Samples:
    """The points of one cycle up to pattern time ``until`` s, without moves broken by a stop and standing pauses."""
    time, watts = _means(recording, match, pattern, until)
    tau, pace = match.warp.to_pattern(time), match.warp.pace(time)
    healthy = load_of(arm.body, arm.parameters, _motion(pattern, tau, pace))
    usual = load_of(arm.body, arm.parameters, _motion(pattern, tau, np.ones_like(pace)))
    faster = healthy.power - usual.power
    unsure = DOUBT * (healthy.slope(arm.parameters) - usual.slope(arm.parameters)) @ arm.deviations
    expected = np.interp(tau, pattern.time, pattern.power) + faster
    third = np.diff(watts, 3)
    noise = max(0.05, float(np.median(np.abs(third))) / (0.6745 * np.sqrt(20.0)))
    spread = np.interp(tau, pattern.time, _spread(pattern))
    shared = _variation(match, pattern, time, tau, expected)
    harmless = np.column_stack([shared, 0.1 * faster, unsure])
    sigma = np.sqrt(noise**2 + spread**2)
    return Samples(time, tau, watts - expected, sigma, harmless, healthy, expected - healthy.power)


def inside_moves(pattern: Pattern, tau: Float, margin: float) -> NDArray[np.bool_]:
    """Whether pattern times (N,) lie within a move, or ``margin`` s from it."""
    inside = np.zeros(len(tau), dtype=bool)
    for start, end in pattern.moves:
        inside |= (tau > start - margin) & (tau < end + margin)
    return inside


def _means(recording: Recording, match: Match, pattern: Pattern, until: float) -> tuple[Float, Float]:
    """Times and mean power of the cycle."""
    first, last = np.searchsorted(recording.time, [match.warp.t[0] - MARGIN, match.warp.t[-1] + MARGIN])
    width = max(1, round(STEP / recording.step))
    count = (last - first) // width
    rows = slice(int(first), int(first + count * width))
    time = recording.time[rows].reshape(count, width).mean(axis=1)
    watts = recording.power[rows].reshape(count, width).mean(axis=1)
    tau = match.warp.to_pattern(time)
    usable = (
        ~np.isnan(watts) & (tau < until) & ((match.warp.pace(time) > STANDING) | inside_moves(pattern, tau, MARGIN))
    )
    for move in match.broken:
        start, end = pattern.moves[move]
        usable &= (tau < start) | (tau > end)
    return time[usable], watts[usable]


def _motion(pattern: Pattern, tau: Float, pace: Float) -> Motion:
    """The healthy path at the pace of a cycle."""
    velocity, acceleration = (
        np.column_stack([np.interp(tau, pattern.time, column) for column in rate.T]) for rate in pattern.rates
    )
    return Motion(pattern.position_at(tau), velocity * pace[:, None], acceleration * pace[:, None] ** 2)


def _spread(pattern: Pattern) -> Float:
    """W (T,) by which the pattern's mean may be off, and a healthy cycle differs from it beyond the noise."""
    width = 9
    padded = np.pad(pattern.spread**2, width // 2, mode="edge")
    variance = np.convolve(padded, np.ones(width) / width, mode="valid")
    noise = np.quantile(variance, 0.2)
    return np.asarray(np.sqrt(np.maximum(variance - noise, 0.0) + variance / pattern.cycles))


def _variation(match: Match, pattern: Pattern, time: Float, tau: Float, expected: Float) -> Float:
    """Columns (N, h) W: level of the supply, timing and size of each move."""
    slope = np.gradient(expected, time)
    resting = expected[~inside_moves(pattern, tau, 0.0)]
    level = float(np.median(resting)) if len(resting) else float(expected.min())
    columns = [np.full(len(time), LEVEL)]
    for move, (start, end) in enumerate(pattern.moves):
        here = (tau >= start - MARGIN) & (tau <= end + MARGIN)
        columns.append(np.where(here, slope * (UNSEEN_SHIFT if move in match.unseen else SHIFT), 0.0))
        columns.append(np.where(here, SHARE * (expected - level), 0.0))
    return np.column_stack(columns)
