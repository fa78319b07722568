"""Times at which rows were sampled: a logger may stamp them at other times than their samples have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.optimize import isotonic_regression
from scipy.signal import find_peaks, savgol_filter

from cellwatt.arrays import Bool, Float

HOLE = 4.5
"""Step, in median steps, across which positions are not compared: the motion in between is unknown."""
GAP = 100.0
"""Step, in usual steps, across which rows are not numbered: how many are missing is uncertain."""
BURST, SEVERAL = 60, 2.0
"""Rows over which steps are averaged, and their mean, in median steps, above which rows come several at once."""
FARTHEST = 4.0
"""Largest distance, in steps, of a stamp from the time that replaces it."""
STALLED = 0.99
"""Share of the rows whose stamps must be within ``FARTHEST``: a logger that stalls stamps a few rows far too late."""
ROUNDING = 1e-6
"""Relative difference of two sums up to which they are equal."""
SMOOTHED = 9
"""Rows over which a velocity is fitted, so that it does not follow the noise of a row."""
SURE = 5.0
"""Standard errors between the evidence of the positions and the middle between both answers."""
STRIDES = (1, 3)
"""Distances, in rows, of the rows compared: neighbours show fast changes of the delay, others slower ones."""
TOGETHER = 10.0
"""Smallest mean square deviation that one time per row removes, relative to noise and to the remainder."""
ALONG = 0.3
"""Share of the fastest joint's speed from which a joint shows the time of a row."""
LEAST = 0.01
"""Standard deviation of the rows' own times about the stamps, in steps, below which the stamps are right."""
FINEST = 1e-7
"""Least noise of a position, rad or m: rounding to single precision."""
SLOWEST = 0.065
"""Time, s, between compared rows above which they do not resolve the motion: where joints move alike, it looks like
wrong times."""
ALTERNATE = -0.55
"""Correlation of the deviations of compared rows, below which single rows are late: -0.8 for white noise. If all
joints turn or brake at once, the motion itself deviates, with fewer changes of sign from row to row."""
NEIGHBOURS = (0, 1, 3, 4)
"""Indices, among five rows a stride apart, of the rows whose cubic is compared with the row in the middle."""
SAMPLES = 0.8, 8.0
"""Samples of a controller per row of a loop that takes the newest one."""
COHERENT = 0.45
"""Mean resultant length of the rows' times, as angles of that controller's period, from which they show the period."""
FINE = 32
"""Parts of a step by which times are told apart where a period is looked for."""
SCANNED, FEWEST = 1 << 15, 200
"""Time, in steps, from the first row on in which a period is looked for, and the fewest rows that show one."""


def in_bursts(time: Float) -> bool:
    """True if rows come several at once throughout: most steps of ``time`` (N,) s are far shorter than their mean."""
    steps = np.diff(time)
    return float(np.median(uniform_filter1d(steps, BURST))) > SEVERAL * float(np.median(steps))


def sampled(time: Float, positions: Sequence[Float]) -> tuple[Float, bool]:
    """Times (N,) s of the samples of ``positions``, each (N,), that a logger stamped at ``time`` (N,) s.

    Even times if the positions show them; then the times of single rows that joints moving together show, as a row that
    was sampled late shows each joint ahead by its velocity times the delay; and if these are multiples of a period, as
    those of a loop that takes a controller's newest sample, the multiples. Missing rows stay missing. ``time`` itself
    if the positions do not show that it is wrong. The flag is false if times of single rows were estimated.
    """
    if len(time) < SMOOTHED or not positions:
        return time, True
    usual = _longest(time)
    if len(after := 1 + np.flatnonzero(np.diff(time) > GAP * usual)):
        parts = [
            sampled(part, each)
            for part, *each in zip(*(np.split(column, after) for column in (time, *positions)), strict=True)
        ]
        found = np.concatenate([part for part, _ in parts])
        return time if np.array_equal(found, time) else found, all(exact for _, exact in parts)
    values = np.column_stack(positions)
    if (near := _close(time, usual)).sum() < SMOOTHED:
        return time, True
    even = _evenly(time, values, near)
    # The motion between bursts is unknown if the stamps are right.
    if even is time and (near := _close(time, float(np.median(np.diff(time))))).sum() < SMOOTHED:
        return time, True
    own = _own(even, values, near)
    if own is not even and (samples := _newest(time, own, values, near)) is not None:
        return samples, True
    found = _ordered(own)
    if np.any(np.diff(found) <= 0) or np.abs(found - even).max() > FARTHEST * float(np.median(np.diff(found))):
        return time, True
    return found, found is even


def _close(time: Float, usual: float) -> Bool:
    """True (N - 4,) at the middle of five rows without a hole, compared with the ``usual`` step, s, between them."""
    return np.asarray(np.convolve(np.diff(time) < HOLE * usual, np.ones(4), "valid") > 3.5)


def _longest(time: Float) -> float:
    """The longest usual step, s: the median one, or that between bursts."""
    steps = np.diff(time)
    return float(np.median(maximum_filter1d(steps, BURST) if in_bursts(time) else steps))


def _evenly(time: Float, values: Float, near: Bool) -> Float:
    """Even times in place of ``time`` (N,) s if ``values`` (N, n), in the stencils ``near`` (N - 4,), show them."""
    best, least = time, np.inf
    if in_bursts(time):  # Long steps hide a part of the motion: what even times leave is compared with what stamps do.
        least = _rough(time, values, near)
    # Across a hole, positions do not show which numbers are right: the stamps do.
    for even, step in sorted(_even(time), key=lambda numbered: float(np.sum(np.square(numbered[0] - time)))):
        weights, late = _cubic(even), time - even
        off = _deviation(weights, values)[near]
        if _near(late / step) and (rough := float(np.sum(np.square(off)))) < least * (1 - ROUNDING):
            stamped = _deviation(weights, late[:, None]) * _speed(values, step)
            best, least = even if _shows(off, stamped[near]) else time, rough
    return best


def _near(late: Float) -> bool:
    """True if rows ``late`` (N,) steps can be those of a logger: not all are exact, and few have far later stamps, none
    of them at the beginning or the end, where it would be rows that are missing."""
    far = max(float(np.quantile(late, STALLED)), late[0], late[-1], -np.min(late))
    return bool(np.max(np.abs(late)) > LEAST and far < FARTHEST)


def _even(time: Float) -> Iterator[tuple[Float, float]]:
    """Candidates (N,) s and their step, s: rows numbered one by one, and by their stamps to the nearest step."""
    steps = np.diff(time)
    usual = steps[steps < HOLE * _longest(time)].mean()
    numbers = np.maximum(np.round(steps / usual), 1.0)
    for counted in (np.ones(len(steps)), numbers):
        number = np.concatenate([[0.0], np.cumsum(counted)])
        step, start = np.polyfit(number, time, 1)
        yield start + step * number, float(step)


def _shows(off: Float, stamped: Float) -> bool:
    """True if the deviations ``off`` at even times are not those, ``stamped``, of rows sampled at their stamps."""
    if not (size := float(np.sum(np.square(stamped)))):
        return False
    share = float(np.sum(off * stamped)) / size
    error = float(np.sqrt(np.mean(np.square(off - share * stamped)) / size))
    return share + SURE * error < 0.5


def _own(time: Float, values: Float, near: Bool) -> Float:
    """Times (N,) s of single rows that the joints of ``values`` (N, n) show together, about ``time`` (N,) s.

    The most probable times, if they deviate from ``time`` by white noise, and positions by that of each joint.
    """
    noise: Float | None = None
    for stride in STRIDES:
        weights, step = _cubic(time, stride), float(np.median(np.diff(time)))
        off, speed = _deviation(weights, values, stride), _speed(values, step, stride)
        whole = np.convolve(near, np.ones(4 * stride - 3), "valid") > 4 * stride - 3.5
        several = np.sqrt(1 + np.sum(np.square(weights), axis=1))[:, None]
        noise = _noise(off / several, speed, whole) if noise is None else noise
        off, speed = off / (several * noise), speed / (several * noise)
        sure = np.where(whole, np.sum(np.square(speed), axis=1), 0.0)
        late = np.sum(off * speed, axis=1) / np.where(sure > 0, sure, np.inf)
        known, size = _common(off, speed, whole)
        spread, again = _spread(late, sure * known, several[:, 0], stride)
        if stride * step > SLOWEST or size < TOGETHER or spread < (LEAST * step) ** 2 or again > ALTERNATE:
            break
        time = time + _delays(weights, sure, late, spread, stride)
    return time


def _ordered(found: Float) -> Float:
    """Times (N,) s without those that are out of order: such a row lies between its neighbours."""
    later = np.minimum.accumulate(found[::-1])[::-1]
    known = np.flatnonzero((found >= np.maximum.accumulate(found)) & (found <= later))
    if len(known) == len(found) or len(known) < STALLED * len(found):
        return found
    return np.interp(np.arange(len(found)), known, found[known])


def _newest(time: Float, found: Float, values: Float, near: Bool) -> Float | None:
    """Even times (N,) s of a controller's samples, the newest one at each stamp ``time`` (N,) s; None if the positions
    ``values`` (N, n) go less well with them than with ``found`` (N,) s, the rows' own times."""
    joints = max(values.shape[1], 2)  # a time of its own takes off the noise of one
    most = _rough(found, values, near) * joints / (joints - 1)
    for start, period, number in _numbered(time, found):
        age = np.sort((time - start) / period - number)
        youngest = age[np.argmax(np.searchsorted(age, age + 1) - np.arange(len(age)))] - ROUNDING
        both = [start + period * n for n in (np.floor((time - start) / period - youngest), number)]
        rough = [_rough(each, values, near) if np.all(np.diff(each) > 0) else np.inf for each in both]
        if min(rough) < most:
            return both[int(np.argmin(rough))]
    return None


def _numbered(time: Float, found: Float) -> Iterator[tuple[float, float, Float]]:
    """Starts and periods, s, of even samples, and the sample's number (N,) of each row.

    The rows' own times ``found`` (N,) s are close to samples or, if the period is near that of the rows, only the steps
    between them: how old samples were at their stamps ``time`` (N,) s then changes too slowly for ``found``.
    """
    step, first = float(np.median(np.diff(found))), float(np.min(found))
    seen = found - first
    scanned = int(np.sum(seen < SCANNED * step))
    counts = np.bincount(np.round(seen[:scanned] * (FINE / step)).astype(np.intp))
    size = 4 * len(counts)
    spectrum = np.fft.rfft(counts, size)
    low, high = (int(size * samples / FINE) for samples in SAMPLES)
    peaks = low + find_peaks(np.abs(spectrum[low:high]), height=COHERENT * scanned)[0]
    for peak in peaks if scanned >= FEWEST else ():
        period, rows = step * size / (FINE * peak), scanned
        start = -period * float(np.angle(spectrum[peak])) / (2 * np.pi)
        while rows < 2 * len(found):  # a period that goes with some rows is good enough to number twice as many
            period, start = np.polyfit(np.round((seen[:rows] - start) / period), seen[:rows], 1)
            rows *= 2
        # Own times that cross belong to successive samples all the same.
        beyond = isotonic_regression((seen - start) / period - np.arange(len(seen))).x
        yield first + start, period, np.arange(len(seen)) + np.round(beyond)
    number = np.concatenate([[0.0], np.cumsum(np.round(np.diff(found) / step))])
    period, start = np.polyfit(number, time, 1)
    yield start, period, number


def _rough(time: Float, values: Float, near: Bool) -> float:
    return float(np.sum(np.square(_deviation(_cubic(time), values)[near])))


def _spread(late: Float, sure: Float, several: Float, stride: int) -> tuple[float, float]:
    """Variance of the rows' times, s², by the deviations ``late`` (M,) s of ``several`` rows each, with the weights
    ``sure`` (M,); and the correlation of deviations a ``stride`` apart."""
    pairs = np.sqrt(sure[stride:] * sure[:-stride]) * late[stride:] * late[:-stride]
    size, total = float(np.sum(sure * np.square(late))), max(float(np.sum(sure)), 1e-30)
    return float(np.sum(sure * np.square(late / several))) / total, float(np.sum(pairs)) / max(size, 1e-30)


def _noise(off: Float, speed: Float, near: Bool) -> Float:
    """Standard deviation (n,) of each position, from its deviations (N - 4, n) where the joint is slow."""
    slow = near[:, None] & (np.abs(speed) <= np.quantile(np.abs(speed[near]), 0.25, axis=0))
    return np.asarray(np.maximum(np.sqrt(np.mean(np.square(off), axis=0, where=slow)), FINEST))


def _common(off: Float, speed: Float, near: Bool) -> tuple[Bool, float]:
    """True (N - 4,) at rows with several moving joints; and the mean square that one time per row removes from the
    deviations ``off`` (N - 4, n), in units of noise, relative to noise and to the remainder."""
    moving = np.abs(speed) >= ALONG * np.max(np.abs(speed), axis=1, keepdims=True)
    rows: Bool = near & (moving.sum(axis=1) > 1) & (np.max(np.abs(speed), axis=1) > 0)
    if not rows.any():
        return rows, 0.0
    off, speed, others = (off * moving)[rows], (speed * moving)[rows], moving[rows].sum(axis=1) - 1
    taken = np.sum(off * speed, axis=1) ** 2 / np.sum(np.square(speed), axis=1)
    left = np.sum((np.sum(np.square(off), axis=1) - taken) / others)
    return rows, float(min(taken.mean(), taken.sum() / max(float(left), 1e-30)))


def _delays(weights: Float, sure: Float, late: Float, spread: float, stride: int) -> Float:
    """Most probable delays (N,) s of rows with the variance ``spread`` s², of which the cubics of ``weights`` show
    ``late`` (M,) s with the inverse variances ``sure`` (M,)."""
    count = len(sure)
    full = np.insert(-weights, 2, 1.0, axis=1)
    banded, right = np.zeros((4 * stride + 1, count + 4 * stride)), np.zeros(count + 4 * stride)
    banded[0] = 1 / spread
    for k in range(5):
        rows = slice(k * stride, k * stride + count)
        right[rows] += sure * full[:, k] * late
        for other in range(k, 5):
            banded[(other - k) * stride, rows] += sure * full[:, k] * full[:, other]
    return np.asarray(solveh_banded(banded, right, lower=True))


def _speed(values: Float, step: float, stride: int = 1) -> Float:
    """Velocities (N - 4 stride, n) of values (N, n)."""
    return np.asarray(savgol_filter(values, SMOOTHED, 2, deriv=1, delta=step, axis=0)[2 * stride : -2 * stride])


def _cubic(time: Float, stride: int = 1) -> Float:
    """Weights (N - 4 stride, 4) of the ``NEIGHBOURS`` of each row in the cubic through them at its ``time`` (N,) s."""
    count = len(time) - 4 * stride
    offsets = [time[k * stride : k * stride + count] - time[2 * stride : -2 * stride] for k in NEIGHBOURS]
    return np.column_stack(
        [np.prod([other / (other - own) for other in offsets if other is not own], axis=0) for own in offsets]
    )


def _deviation(weights: Float, values: Float, stride: int = 1) -> Float:
    """Deviations (N - 4 stride, n) of values (N, n) from the cubics of their neighbours."""
    out = values[2 * stride : -2 * stride].copy()
    for k, weight in zip(NEIGHBOURS, weights.T, strict=True):
        out -= weight[:, None] * values[k * stride : k * stride + len(weight)]
    return out
