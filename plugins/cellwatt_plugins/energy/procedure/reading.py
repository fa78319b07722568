"""One reading at rest: wait until the power is steady, and say how well its mean is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.energy.fixed import Steady, steady_power
from cellwatt_plugins.energy.procedure.live import Feed
from cellwatt_plugins.energy.procedure.log import AtRest
from cellwatt_plugins.energy.recordings import Reading

Float = NDArray[np.float64]

WINDOW: Final = 60.0
"""s that a reading is long."""
PATIENCE: Final = 900.0
"""s: what is not steady by then is told as it is."""
KNOWN: Final = 0.05
"""W: the mean must be known so well, one standard deviation."""
NEAR: Final = 0.02
"""rad by which a joint may be away from the pose of least gravity."""
TURN: Final = 0.25
"""s between two looks."""
FEWEST: Final = 20
"""Values in a reading, at least."""
SILENT: Final = 20.0
"""s without a value, after which the operator is told."""


@dataclass(frozen=True)
class Taken:
    """A reading, and what speaks against it."""

    reading: AtRest
    objections: tuple[str, ...]


def settled(state: Steady) -> bool:
    """The stated test: a straight line through the window rises or falls by less than 0.2 W, or by less than four of
    its standard errors; and the mean is known to ``KNOWN``."""
    return state.steady and state.uncertainty <= KNOWN


def take_reading(
    feed: Feed,
    tell: Callable[[str], None],
    window: float = WINDOW,
    patience: float = PATIENCE,
    pose: Float | None = None,
) -> Taken | None:
    """The first ``window`` s that are steady; after ``patience`` s the last, with an objection.

    ``pose`` (n,) rad: where the arm should be. None where the analyzer says nothing for ``SILENT`` s.
    """
    heard, seen = monotonic(), 0
    while True:
        feed.take(TURN)
        time, power = feed.time, feed.power
        if len(time) == seen:
            if monotonic() - heard > SILENT:
                return None
            continue
        heard, seen = monotonic(), len(time)
        span = float(time[-1] - time[0]) * 1e-9
        first = int(np.searchsorted(time, time[-1] - round(window * 1e9)))
        if span < window or seen - first < FEWEST:
            tell(f"{power[-1]:8.2f} W   {span:4.0f} of {window:.0f} s")
            continue
        state = steady_power(Reading("the analyzer", (time[first:] - time[0]) * 1e-9, power[first:]))
        tell(f"{power[-1]:8.2f} W   mean {state.power:.2f} ± {state.uncertainty:.3f} W, drift {state.drift:+.2f} W")
        if settled(state) or span > patience:
            return _taken(state, (int(time[first]), int(time[-1])), pose, feed.joints)


def _taken(state: Steady, span: tuple[int, int], pose: Float | None, joints: Float | None) -> Taken:
    against = []
    if not state.steady:
        against.append(f"not steady: drifted by {state.drift:+.2f} W; let it warm up, and take it again")
    elif state.uncertainty > KNOWN:
        against.append(f"the mean is only known to ±{state.uncertainty:.2f} W: something switches; look what it is")
    if pose is not None:
        against += _away(pose, joints)
    reading = AtRest(start=span[0], end=span[1], power=state.power, uncertainty=state.uncertainty, drift=state.drift)
    return Taken(reading, tuple(against))


def _away(pose: Float, joints: Float | None) -> list[str]:
    if joints is None or not np.isfinite(joints).all():
        return ["the arm says nothing of its joints: whether it is at the rest pose is not known"]
    if len(joints) != len(pose):
        return [f"the arm has {len(joints)} joints, robot.yaml {len(pose)}: is it the same robot?"]
    off = np.abs((joints - pose + np.pi) % (2 * np.pi) - np.pi)
    far = [f"joint {i + 1} by {np.degrees(angle):.1f}" for i, angle in enumerate(off) if angle > NEAR]
    return [f"the arm is not at the rest pose: {', '.join(far)} deg away"] if far else []
