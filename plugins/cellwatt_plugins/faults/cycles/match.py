"""Finds known cycles in runs of motion, even if one or two encoders do not show the known path."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.pattern import POSE, WAY, Pattern, Timing, Warp, timing, warp_of
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import Run, without_jumps

COINCIDENCE = 4.0
"""Log odds against another task per move of a joint that ends at its known position: within about half a degree, in a
range of a radian."""
FOREIGN_ODDS = 12.0
"""Largest log odds; reached if more moves match the pattern than one, plus one for each joint off its path."""
BEYOND = 2.0
"""An encoder counts as right again only if a wrong scale would cause an error of this many times the limit."""


def known_odds(seen: Sequence[tuple[int, Run, Run]], pattern: Pattern, odd: Sequence[int]) -> float:
    """Log odds against another task that begins like ``pattern``.

    ``seen``: its moves with the first and last run of each; ``odd``: the joints (0-based) off their path. Each joint in
    ``odd`` but the first cancels the evidence of one joint on its path, as there are more sets to choose from.
    """
    if any(_right_again(seen, pattern, joint) for joint in odd):
        return 0.0
    if len(seen) > 1 + len(odd):
        return FOREIGN_ODDS
    off = np.logical_or.accumulate(_missed(seen, pattern)[:, list(odd)].any(axis=1))
    on_path = np.delete(pattern.ways[[move for move, _, _ in seen]], odd, axis=1) > WAY
    company = 1 - len(odd) + int(on_path[off].sum())
    return min(FOREIGN_ODDS, COINCIDENCE * max(0, company))


def _missed(seen: Sequence[tuple[int, Run, Run]], pattern: Pattern) -> NDArray[np.bool_]:
    """True (k, n) for each joint that begins or ends a seen move off its pose in the pattern."""
    moves = [move for move, _, _ in seen]
    before = np.abs(np.array([first.before for _, first, _ in seen]) - pattern.poses[0][moves])
    after = np.abs(np.array([last.after for _, _, last in seen]) - pattern.poses[1][moves])
    return np.asarray(np.maximum(before, after) > pattern.limits)


def _off_path(seen: Sequence[tuple[int, Run, Run]], pattern: Pattern, unknown: NDArray[np.bool_] | None) -> set[int]:
    """Joints (0-based) that miss a pose, or a move between two seen ones that no hole of the recording hides.

    Nothing shows that another joint left its path: the recording or the arm began, or stopped, within the cycle.
    """
    skipped = [
        move
        for (before, _, one), (after, other, _) in pairwise(seen)
        if unknown is None or not unknown[one.last : other.first].any()
        for move in range(before + 1, after)
    ]
    off = _missed(seen, pattern).any(axis=0) | (pattern.ways[skipped] > WAY).any(axis=0)
    return set(np.flatnonzero(off).tolist())


def _hides(
    steps: Sequence[_Step], runs: Sequence[Run], pattern: Pattern, odd: Sequence[int], unknown: NDArray[np.bool_] | None
) -> set[int]:
    """Joints (0-based) whose encoder hides the cycle's first or last moves, and not a cut or an aborted cycle.

    The encoder jumps in a rest, or it stays where it was while the joints on their path begin the next cycle.
    """
    spans = [step.runs for step in steps if step.runs is not None]
    seen = [k for k, step in enumerate(steps) if step.runs is not None]
    due_first, due_last = (
        (pattern.ways[[step.move for step in part]] > WAY).any(axis=0)
        for part in (steps[: seen[0]], steps[seen[-1] + 1 :])
    )
    keep = np.delete(np.arange(len(pattern.repeat)), odd)
    limit, shown = pattern.limits[keep], np.flatnonzero((pattern.ways[:, keep] > WAY).any(axis=1))
    at, (last, *later) = spans[0][0], runs[spans[-1][1] :]
    early, late = np.abs(runs[at].jumped[0]) > pattern.limits, np.abs(last.jumped[1]) > pattern.limits
    if later and len(shown) and (unknown is None or not unknown[last.last : later[0].first].any()):
        anew = all(
            _is(pose[keep], poses[shown[0], keep], limit)
            for pose, poses in zip((later[0].before, later[0].after), pattern.poses, strict=True)
        )
        late |= anew & (np.abs(later[0].before - pattern.poses[0][0]) > pattern.limits)
    within = [np.abs(run.jumped[0]) > pattern.limits for run in runs[at + 1 : spans[-1][1] + 1]]
    hidden = due_first & early | due_last & late | np.any(within, axis=0)
    return set(np.flatnonzero(hidden).tolist())


def _right_again(seen: Sequence[tuple[int, Run, Run]], pattern: Pattern, joint: int) -> bool:
    """True if a joint returns to its path after a rest off it, which a shifted or stuck encoder, or one of a wrong
    scale (whose error is small near the cycle's start pose), does not show."""
    shown = np.array([seen[0][1].before[joint], *(last.after[joint] for _, _, last in seen)])
    healthy = pattern.poses[1][[move for move, _, _ in seen], joint]
    healthy = np.concatenate([[pattern.poses[0][seen[0][0], joint]], healthy])
    away = np.abs(healthy - pattern.poses[0][0, joint])
    error, limit = np.abs(shown - healthy), float(pattern.limits[joint])
    for before in np.flatnonzero(error > limit):
        scaled = error[before] * away[before + 1 :] / max(float(away[before]), WAY)
        went = np.abs(shown[before + 1 :] - shown[before]) > WAY
        if np.any((error[before + 1 :] < limit) & (scaled > BEYOND * limit) & went):
            return True
    return False


MOST_ODD = 2
"""Most joints off their path in a known cycle."""
FEWEST_SEEN = 0.5
"""Smallest share of a cycle's moves that must be seen."""
FEWEST_BEGUN = 1
"""Fewest moves of a running cycle that must be seen."""
ALIKE = 0.05
"""A wrong encoder shows the same share of its healthy displacement in every move, within this …"""
LEAST_SHARE, MOST_SHARE = 0.5, 1.6
"""… and the share lies between these."""
EVEN = 0.03
"""Largest timing error of an uninterrupted move, s."""
EVEN_ALONE = 0.01
"""Largest timing error of a short move, or of one shown only by joints off their path, s; above it the move counts as
unseen."""
POINTS = 500
"""Number of points of a move's path that are compared with the poses of stops."""
SLOWEST, FASTEST = 0.2, 2.5
"""Range of the pace, relative to the pattern, of a move that matches the pattern."""


@dataclass(frozen=True)
class Match:
    """A known cycle: index of its ``pattern``, indices of its ``first`` and ``last`` run, ``odd`` joints (0-based) off
    their path, ``warp`` to the pattern, moves ``unseen`` or ``broken`` by a stop, ``pace`` relative to the pattern.

    ``known``: log odds against another task that begins like it, from the joints on their path.
    """

    pattern: int
    first: int
    last: int
    odd: tuple[int, ...]
    warp: Warp
    unseen: tuple[int, ...]
    broken: tuple[int, ...]
    pace: float
    known: float


@dataclass(frozen=True, slots=True)
class _Step:
    """A move of the pattern and its ``runs`` (first, last index), None if unseen.

    ``joints`` (0-based) give its timing: those on their path, or the others if only those move.
    """

    move: int
    runs: tuple[int, int] | None
    joints: tuple[int, ...]


def find_cycles(recording: Recording, runs: Sequence[Run], patterns: Sequence[Pattern]) -> list[Match]:
    """Known cycles in the order of their runs."""
    found: list[Match] = []
    recording = replace(recording, position=without_jumps(recording.position))
    at = 0
    while at < len(runs):
        # With the fewest joints off their path, then the best of these.
        by_number = (_options(recording, runs, patterns, at, number, whole=True) for number in range(MOST_ODD + 1))
        options = next(filter(None, by_number), [])
        found += [_best(options)] if options else []
        at = found[-1].last + 1 if options else at + 1
    return found


def begun_cycle(recording: Recording, runs: Sequence[Run], patterns: Sequence[Pattern]) -> Match | None:
    """The known cycle that is running after the last run, up to that run; None if several tasks are possible.

    The last run must have ended, as it is the cycle's last move so far.
    """
    recording = replace(recording, position=without_jumps(recording.position))
    for number in range(MOST_ODD + 1):
        for at in range(len(runs)):
            if options := _options(recording, runs, patterns, at, number, whole=False):
                one_task = len({patterns[match.pattern].task for match in options}) == 1
                return _best(options) if one_task else None
    return None


def _best(options: Iterable[Match]) -> Match:
    return max(options, key=lambda m: (-len(m.broken), m.last - m.first, -abs(math.log(m.pace))))


def _options(
    recording: Recording, runs: Sequence[Run], patterns: Sequence[Pattern], at: int, number: int, *, whole: bool
) -> list[Match]:
    """Whole or running cycles that begin with run ``at`` while ``number`` joints are off their path."""
    out: list[Match] = []
    for index, pattern in enumerate(patterns):
        # Too far from the pattern's start pose, even if the first move is unseen.
        far = np.flatnonzero(np.abs(runs[at].before - pattern.poses[0][0]) > pattern.limits + WAY).tolist()
        others = [joint for joint in range(recording.joints) if joint not in far]
        for more in combinations(others, number - len(far)) if len(far) <= number else ():
            odd = tuple(sorted((*far, *more)))
            steps = _walk(runs, pattern, at, odd, whole=whole)
            if steps is None or not (whole or _reach(steps, len(runs) - 1)):
                continue
            match = _timed(recording, runs, pattern, index, steps, odd)
            # A last move without its timing is not judged, but it may be all that shows a joint off its path.
            out += [match] if match and (whole or _reach(steps, len(runs) - 1, match.unseen)) else []
    return out


def _reach(steps: Sequence[_Step], last: int, unseen: Sequence[int] = ()) -> bool:
    """True if a move, other than those ``unseen``, ends with run ``last``."""
    return any(step.runs is not None and step.runs[1] == last and step.move not in unseen for step in steps)


def _walk(runs: Sequence[Run], pattern: Pattern, at: int, odd: Sequence[int], *, whole: bool) -> list[_Step] | None:
    """Match runs from ``at`` on with the moves of a pattern, by the joints that are not ``odd``.

    Unless a ``whole`` cycle is wanted, the match may end with the last run.
    """
    keep = np.array([j for j in range(len(pattern.repeat)) if j not in odd])
    on_path = tuple(keep.tolist())
    limit = pattern.limits[keep]
    before = pattern.poses[0][:, keep]
    shown: list[bool] = np.any(pattern.ways[:, keep] > WAY, axis=1).tolist()
    # Joints on their path that go at least as far as the odd ones show whether a run is the whole move.
    most, most_odd = (pattern.ways[:, part].max(axis=1, initial=0.0) for part in (keep, list(odd)))
    leads: list[bool] = (most >= most_odd).tolist()
    steps: list[_Step] = []
    shares: dict[int, list[float]] = {joint: [] for joint in odd}
    for move in range(len(shown)):
        if at == len(runs) and not whole:
            break
        begins = at < len(runs) and _is(runs[at].before[keep], before[move], limit)
        begins = begins and (leads[move] or _is_uncut(runs[at], pattern, move, 0))
        still = begins and _is(runs[at].before[keep], runs[at].after[keep], limit)
        end = _end(runs, at, keep, pattern, move) if begins and not still else None
        # A short move is seen in some cycles, and in one run.
        if end is not None and (leads[move] or _is_uncut(runs[end], pattern, move, 1)) and (shown[move] or end == at):
            steps.append(_Step(move, (at, end), on_path))
            at = end + 1
        elif shown[move]:
            return None
        else:
            still = still and _is_uncut(runs[at], pattern, move, 1)
            alone = _alone(runs[at], pattern, move, shares) if still else ()
            steps.append(_Step(move, (at, at) if alone else None, alone))
            at += still and _stirs(runs[at], pattern, move, odd)
    steps = _without(steps, {joint for joint, of in shares.items() if of and max(of) - min(of) > ALIKE})
    fewest = max(2, FEWEST_SEEN * len(steps)) if whole else FEWEST_BEGUN
    return steps if sum(s.runs is not None for s in steps) >= fewest else None


def _without(steps: Sequence[_Step], joints: Collection[int]) -> list[_Step]:
    """The steps without timing by ``joints``; steps shown only by these become unseen."""
    remaining = [(step, tuple(joint for joint in step.joints if joint not in joints)) for step in steps]
    return [replace(step, runs=step.runs if rest else None, joints=rest) for step, rest in remaining]


def _stirs(run: Run, pattern: Pattern, move: int, odd: Sequence[int]) -> bool:
    """True if a run moves an ``odd`` joint that this move should move; if not, the run belongs to a later move."""
    due = pattern.ways[move, list(odd)] > POSE
    return bool(np.any((np.abs(run.after - run.before)[list(odd)] > POSE) & due))


def _alone(run: Run, pattern: Pattern, move: int, shares: Mapping[int, list[float]]) -> tuple[int, ...]:
    """Joints off their path that show a move of no other joint; adds the shown shares of displacement to ``shares``."""
    there = pattern.poses[1][move] - pattern.poses[0][move]
    out = []
    for joint, of in shares.items():
        if abs(there[joint]) <= WAY:
            continue
        share = float((run.after[joint] - run.before[joint]) / there[joint])
        if LEAST_SHARE < share < MOST_SHARE:
            of.append(share)
            out.append(joint)
    return tuple(out)


def _end(runs: Sequence[Run], at: int, keep: NDArray[np.intp], pattern: Pattern, move: int) -> int | None:
    """The run that ends a move begun with run ``at``: the same one, or a later one if the move was interrupted.

    A move with several stops must come further along its path with each, so that a detour is no interrupted move.
    """
    after, limit = pattern.poses[1][move, keep], pattern.limits[keep]
    for last in range(at, len(runs)):
        here, on = runs[last].after[keep], runs[min(last + 1, len(runs) - 1)]
        if _is(here, after, limit):
            return last
        stops = [run.after[keep] for run in runs[at : last + 1]]
        goes_on = _is(here, on.before[keep], limit) and not _is(on.before[keep], on.after[keep], limit)
        if not goes_on or (len(stops) > 1 and not _is_on_path(stops, pattern, move, keep)):
            return None
    return None


def _is_on_path(stops: Sequence[Float], pattern: Pattern, move: int, keep: NDArray[np.intp]) -> bool:
    """True if a move of the pattern passes ``stops``, poses (k,) rad of the joints ``keep``, in their order."""
    path = pattern.position_at(np.linspace(*pattern.moves[move], POINTS))[:, keep]
    far = np.abs(path[:, None] - np.array(stops)).max(axis=2)
    return bool((far.min(axis=0) < WAY).all() and (np.diff(far.argmin(axis=0)) > 0).all())


def _is_uncut(run: Run, pattern: Pattern, move: int, end: int) -> bool:
    """True if a run is whole, or if every joint begins (``end`` 0) or ends (1) it where a move of the pattern does."""
    return run.whole or _is((run.before, run.after)[end], pattern.poses[end][move], pattern.limits)


def _is(pose: Float, other: Float, limit: Float) -> bool:
    return bool((np.abs(pose - other) < limit).all())


def _timed(
    recording: Recording, runs: Sequence[Run], pattern: Pattern, index: int, steps: Sequence[_Step], odd: Sequence[int]
) -> Match | None:
    """The match with its time map; None if its pace is out of range or a joint of ``odd`` is not off its path."""
    seen = [(step.move, runs[step.runs[0]], runs[step.runs[1]]) for step in steps if step.runs is not None]
    off = _off_path(seen, pattern, recording.unknown)
    if not off >= set(odd) and not off | _hides(steps, runs, pattern, odd, recording.unknown) >= set(odd):
        return None
    timings: list[tuple[int, Timing]] = []
    broken: list[int] = []
    unseen = [step.move for step in steps if step.runs is None]
    for step in steps:
        if step.runs is None:
            continue
        first, last = step.runs
        found = timing(pattern, step.move, recording, (runs[first].first, runs[last].last), step.joints)
        short = pattern.ways[step.move, list(step.joints)].max() <= WAY
        if found.error > EVEN_ALONE and (short or set(step.joints) <= set(odd)):
            unseen.append(step.move)
            continue
        if last > first or found.error > EVEN:
            broken.append(step.move)
            # No line fits the path of a move with a stop: its edges are those of its runs.
            begin, end = recording.time[[runs[first].first, runs[last].last]].tolist()
            found = Timing(begin, end, found.error)
        timings.append((step.move, found))
    lengths = np.ptp(pattern.moves, axis=1).tolist()
    paces = [lengths[m] / (t.end - t.start) for m, t in timings if m not in broken and t.end > t.start]
    if not paces or not all(SLOWEST < p < FASTEST for p in paces):
        return None
    spans = [step.runs for step in steps if step.runs is not None]
    return Match(
        pattern=index,
        first=spans[0][0],
        last=spans[-1][1],
        odd=tuple(odd),
        warp=warp_of(pattern, timings),
        unseen=tuple(unseen),
        broken=tuple(broken),
        pace=float(np.median(paces)),
        known=known_odds(seen, pattern, odd),
    )
