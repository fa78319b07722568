"""Lack of fit: channels whose residual is not noise, and where: effects that are in no library."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.noise import windowed
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.fit.swinging_links import chi2_at_rest, swinging_channels
from cellwatt_plugins.explain.verdict.findings import Span, UnexplainedChannel

SHARE = 0.2
"""Residual that counts as lack of fit, as a share of the error that the named effects explain."""
ROUGH = 4.0
"""The same for channels with effects that are simulated sample by sample and sensitive to their course; there the
residual without swinging links must reach ``SHARE`` of the whole as well."""
WINDOW = 0.5
"""s of the windows in which the residual is judged."""
STRONG = 6.0
"""Mean square residual of a window, in units of the noise, that chance does not produce."""
AGAIN = 5
"""Smallest number of strong windows: what happens once or twice is not physics of the arm."""


@dataclass(frozen=True)
class LackOfFit:
    """A channel (0-based) whose residual is not noise, and where."""

    channel: int
    rms: float
    floor: float
    velocity: tuple[float, float] | None
    position: tuple[float, float] | None
    times: tuple[Span, ...]


def lack_of_fit(before: Float, solution: Solution, most: float = 0.35, size: float = 0.03) -> list[LackOfFit]:
    """Channels whose residual is not noise; ``before`` (C,) is the mean square residual with nominal parameters alone.

    ``most`` is the largest acceptable mean square residual beyond noise of a channel, in units of the noise; ``size``
    is the share of the measured standard deviation below which a residual is too small to matter. For an intermittent
    residual, the size is that in the windows where it is strong.
    """
    problem, residual = solution.problem, solution.residual
    chi2 = problem.chi2(residual)
    rough, calm = swinging_channels(solution), chi2_at_rest(solution)
    out = []
    for channel, excess in enumerate(chi2 - 1.0):
        explained = max(0.0, float(before[channel] - chi2[channel]))
        share = ROUGH if channel in rough else SHARE
        theirs = channel in rough and calm[channel] - 1.0 < max(most, SHARE * excess)
        if excess > max(most, share * explained) and not theirs:
            means = np.concatenate([np.mean(w, axis=1) for w in _windows(solution, channel)])
            strong = means > STRONG
            acts = float(np.mean(means[strong])) - 1.0 if strong.sum() >= AGAIN else excess
            if np.sqrt(acts) * problem.floor[channel] >= size * problem.measured[channel]:
                out.append(_place(solution, channel, strong))
    return out


def _windows(solution: Solution, channel: int) -> list[Float]:
    """Squared residual divided by its variance, in windows of each run, (W, samples)."""
    problem = solution.problem
    squared = np.square(solution.residual * problem.design.root)
    pairs = zip(problem.rows, problem.split(squared), strict=True)
    return [windowed(part, max(1, round(WINDOW / rows.step)))[:, :, channel] for rows, part in pairs]


def _place(solution: Solution, channel: int, strong: NDArray[np.bool_]) -> LackOfFit:
    problem = solution.problem
    rms = float(np.sqrt(np.mean(np.square(solution.residual[:, channel]))))
    spans, positions, speeds, at = [], [], [], 0
    every = zip(problem.states, problem.rows, _windows(solution, channel), strict=True)
    for states, rows, windows in every:
        width = windows.shape[1]
        for i in range(len(windows)):
            if strong[at + i]:
                part = rows.span(slice(i * width, (i + 1) * width))
                spans.append(Span(states.name, float(states.time[part][0]), float(states.time[part][-1])))
                if problem.side == "torque":
                    positions.append(states.q[part, channel])
                    speeds.append(states.qd[part, channel])
        at += len(windows)
    position, velocity = (
        mostly(np.concatenate(parts), np.concatenate([getattr(s, name)[:, channel] for s in problem.states]))
        if parts
        else None
        for name, parts in (("q", positions), ("qd", speeds))
    )
    return LackOfFit(channel, rms, float(problem.floor[channel]), velocity, position, tuple(_joined(spans)[:20]))


def mostly(values: Float, everywhere: Float) -> tuple[float, float] | None:
    """Range that holds 90 % of the values; None if it covers nearly the whole range."""
    low, high = np.quantile(values, [0.05, 0.95])
    return None if high - low > 0.7 * np.ptp(everywhere) else (float(low), float(high))


def _joined(spans: list[Span]) -> list[Span]:
    out: list[Span] = []
    for span in spans:
        if out and out[-1].recording == span.recording and span.start - out[-1].end < 0.1:
            out[-1] = Span(span.recording, out[-1].start, span.end)
        else:
            out.append(span)
    return out


def between(found: LackOfFit, unit: str) -> str:
    """Phrase for the positions at which a channel in ``unit`` mostly lacks fit; empty if that is everywhere."""
    if found.position is None:
        return ""
    return f", mostly between {found.position[0]:.2f} and {found.position[1]:.2f} {'m' if unit == 'N' else 'rad'}"


def unexplained_channel(found: LackOfFit, name: str, unit: str, looked_at: bool = True) -> UnexplainedChannel:
    """An unexplained channel for ``findings.json``; ``looked_at`` is False if the time limit came first."""
    times = found.rms / found.floor
    where = between(found, unit)
    size, noise = f"{found.rms:.3g} {unit.replace('*', '')}", f"{times:.1f} times its noise"
    statement = (
        f"{name} has a residual of {size} that no known effect explains, {noise}{where}."
        if looked_at
        else f"{name} was not looked at in full: the time limit was reached (--time); it has {size}, {noise}{where}."
    )
    return UnexplainedChannel(name, found.rms, found.floor, statement, found.velocity, found.position, looked_at)
