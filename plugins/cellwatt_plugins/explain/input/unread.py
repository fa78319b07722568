"""Torques without information on the arm: not recorded, not read while the joint moved, or of drives that were off."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from cellwatt.arrays import Bool, Float
from cellwatt.report.numbers import number
from cellwatt_plugins.explain.input.factors import MOVES, joints_text, usable
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot.motion import rates
from cellwatt_plugins.robot.samples import unpowered
from cellwatt_plugins.robot.stretches import stretches

SAMPLES = 2000
"""Samples of a run that are examined."""
COUNTS = 16
"""Largest number of different values of a channel that contains converter noise only."""
LITTLE = 0.002
"""Share of the arm's largest torque spread below which a torque unrelated to the motion counts as not read."""
RELATED = 0.1
"""Least share of a torque's variance that the arm's motion explains; friction alone explains most of it."""
TURNED = 0.02
"""rad/s over which friction changes its sign."""
ROWS_EACH = 10
"""Rows per term that a regression needs to distinguish relation from chance."""

HELD = (0.25, 1.0)
"""Time, s, over which the torques of all moving joints, or of one, cannot stay at one value."""
LEVELS = 50
"""Number of different torques of a joint below which the steps between them are visible: one value may be rounding."""
STILL = 0.01
"""rad/s below which a joint rests."""
CHANCE = 4.0
"""Standard deviations of the mean noise at rest below which a joint has no torque."""
AVERAGED, SHORTEST = 0.5, 1.0
"""Time, s, over which torques are averaged, and shortest time without torque after which drives count as off."""
SELDOM = 3.0
"""Rows without torque, in the usual distance of rows that have some, above which none was read."""


def without_unread(run: Run) -> Run:
    """The run with NaN for the torque of each joint whose channel is constant, or noise unrelated to the motion; while
    torques stay at one value although joints move; and for all torques while the drives are off. Where power was
    recorded, rows without drives before and after all motion count as filled in."""
    dead = _dead(run)
    run = replace(run, torque=np.where(dead, np.nan, run.torque)) if dead.any() else run
    if (frozen := _frozen(run)).any():
        names = joints_text((1 + np.flatnonzero(frozen.any(axis=0))).tolist())
        rows = frozen.any(axis=1)
        note = (
            f"{run.name}: the torque of {names} stays at one value for {number(run.step * np.sum(rows), 2)} s in all "
            f"while joints move, first at {run.time[np.argmax(rows)]:.2f} s: it was not read there, and is not used"
        )
        run = replace(run, torque=np.where(frozen, np.nan, run.torque), notes=(*run.notes, note))
    off = _off(run)
    if not off.any():
        return run
    note = (
        f"{run.name}: {number(run.step * np.count_nonzero(off), 2)} s at rest without torque at any joint, first "
        f"at {run.time[np.argmax(off)]:.2f} s: the drives were off. Their torque is not used"
    )
    gaps = run.gaps
    if run.power is not None:
        # Between two motions, the power of braked joints is that without their brakes.
        gaps = run.filled | (off & ~_amid_motion(run))
        note += ", nor their power before the first and after the last motion"
    return replace(run, torque=np.where(off[:, None], np.nan, run.torque), gaps=gaps, notes=(*run.notes, note))


def unread(run: Run) -> Bool:
    """(n,) true where a run holds no torque of a joint."""
    return np.asarray(np.isnan(run.torque).all(axis=0), np.bool_)


def unread_remarks(runs: Sequence[Run]) -> Iterator[str]:
    """One note on the joints whose torque is not used."""
    silent = np.array([unread(run) for run in runs])
    joints = np.flatnonzero(silent.any(axis=0))
    if not len(joints):
        return
    names = [run.name for run, one in zip(runs, silent, strict=True) if one.any()]
    where = "" if silent[:, joints].all() else f" in {', '.join(names)}"
    yield (
        f"no torque of {joints_text((1 + joints).tolist())}{where}: the column is absent, empty, constant, or "
        "noise unrelated to the motion. It is not used; the other joints are"
    )


def _dead(run: Run) -> Bool:
    rows = usable(run, SAMPLES)
    dead = unread(run)
    recorded = np.flatnonzero(~dead)
    if not len(recorded) or not len(rows):
        return dead
    torque = run.torque[rows]
    moves = np.ptp(run.position[rows], axis=0) > MOVES
    size = np.zeros(run.joints)
    size[recorded] = np.nanstd(run.torque[:, recorded], axis=0)
    constant = np.zeros(run.joints, bool)
    constant[recorded] = np.nanmax(run.torque[:, recorded], axis=0) == np.nanmin(run.torque[:, recorded], axis=0)
    dead |= constant & (moves | (run.torque[0] == 0))
    levels = np.array([len(np.unique(column[np.isfinite(column)])) for column in run.torque.T])
    suspect = moves & ~dead & ((size < LITTLE * size.max()) | (levels <= COUNTS))
    if suspect.any():
        terms = _terms(run)[rows]
        dead[suspect] = [_related(terms, torque[:, i]) < RELATED for i in np.flatnonzero(suspect)]
    return dead


def _frozen(run: Run) -> Bool:
    """(N, n) true where the torques of all joints stay at one value for ``HELD[0]`` s while several move, or the torque
    of one for ``HELD[1]`` s while it moves; not at their extremes, where they may be cut off."""
    out, read = np.zeros(run.torque.shape, np.bool_), np.flatnonzero(~unread(run)).tolist()
    alone = [j for j in read if len(np.unique(run.torque[:, j])) >= LEVELS]
    for joints, least, several in ((read, HELD[0], 2), *(([j], HELD[1], 1) for j in alone)):
        torque = run.torque[:, joints]
        same = np.all(np.diff(torque, axis=0) == 0, axis=1)
        for first, last in stretches(same) if joints else ():
            moved = np.ptp(run.position[first : last + 1, joints], axis=0) > MOVES
            inside = (torque[first] > np.nanmin(torque, axis=0)) & (torque[first] < np.nanmax(torque, axis=0))
            if (last - first) * run.step > least and moved.sum() >= several and inside.any():
                out[first : last + 1, joints] = True
    return out


def _off(run: Run) -> Bool:
    """(N,) true at rests in which no joint has torque: brakes hold the arm, and drives or their sensors are off."""
    torque = _between(run.torque[:, ~unread(run)], run.step)
    still = np.all(np.abs(rates(run.position, run.step)[1]) < STILL, axis=1)
    if not torque.size or run.step * still.sum() < SHORTEST:
        return np.zeros(len(still), np.bool_)
    window = max(1, round(AVERAGED / run.step))
    mean = uniform_filter1d(torque, window, axis=0, mode="nearest")
    noise = np.std(np.diff(torque, axis=0)[still[1:]], axis=0) / np.sqrt(2 * window)
    idle = still & unpowered(mean, CHANCE * noise)
    off = np.zeros(len(still), np.bool_)
    for first, end in stretches(idle):
        if (end - first) * run.step >= SHORTEST:
            off[max(first - window // 2, 0) : end + window // 2] = True
    return np.asarray(off & still, np.bool_)


def _between(torque: Float, step: float) -> Float:
    """Torques (N, n) Nm, interpolated between those that were read; 0 where none was for long, as drives were off."""
    out = torque.copy()
    for column in out.T:
        missing = np.isnan(column)
        read = np.flatnonzero(~missing)
        longest = max(SHORTEST / step, SELDOM * float(np.median(np.diff(read, prepend=read[0] - 1))))
        column[missing] = np.interp(np.flatnonzero(missing), read, column[read])
        for first, end in stretches(missing):
            if end - first > longest:
                column[first:end] = 0.0
    return out


def _amid_motion(run: Run) -> Bool:
    """(N,) true from the first to the last motion."""
    away = [np.any(np.abs(q - q[0]) > MOVES, axis=1) for q in (run.position, run.position[::-1])]
    begun, unfinished = (np.logical_or.accumulate(one) for one in away)
    return np.asarray(begun & unfinished[::-1], np.bool_)


def _terms(run: Run) -> Float:
    """Regressors (N, 5 n) of an arm's friction, weight and inertia."""
    _, velocity, acceleration = rates(run.position, run.step)
    q = run.position
    return np.column_stack([np.tanh(velocity / TURNED), velocity, acceleration, np.sin(q), np.cos(q)])


def _related(terms: Float, torque: Float) -> float:
    """Share of the variance of ``torque`` (N,) that ``terms`` (N, k) explain beyond chance; 1 if rows are too few."""
    rows = np.isfinite(torque)
    count, unknowns = int(rows.sum()), terms.shape[1] + 1
    if count < ROWS_EACH * unknowns:
        return 1.0
    wanted = torque[rows] - torque[rows].mean()
    centred = terms[rows] - terms[rows].mean(axis=0)
    residual = wanted - centred @ np.linalg.lstsq(centred, wanted, rcond=None)[0]
    return float(1 - np.var(residual) / np.var(wanted) * (count - 1) / (count - unknowns))
