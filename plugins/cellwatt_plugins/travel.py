"""Travel of linear axes as angles, so that one threshold in rad serves every joint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt.frames import Layout
from cellwatt.results import Interval

LEVER: Final = 0.2
"""Travel, m, of a prismatic joint that counts as 1 rad of a revolute one."""


def levers_of(layout: Layout, positions: Sequence[int]) -> Float:
    """Travel (n,) that counts as 1 rad, by the units of the joints' ``positions`` in frames: ``LEVER`` m, or 1 rad."""
    return np.array([LEVER if layout.channels[column].unit == "m" else 1.0 for column in positions])


def scaled(interval: Interval, by: Float) -> Interval:
    """The interval with the positions and speeds of each joint multiplied by ``by`` (n,)."""
    pose, way, speed = (
        tuple((np.asarray(values) * by).tolist())
        for values in (interval.pose, interval.displacement, interval.peak_speed)
    )
    return replace(interval, pose=pose, displacement=way, peak_speed=speed)


def travel_text(angle: float, lever: float) -> str:
    """The travel ``angle`` rad of a joint in words: in degrees, or in mm if its ``lever`` is that of a linear axis."""
    return f"{math.degrees(angle):.1f}°" if lever == 1.0 else f"{1000 * lever * angle:.1f} mm"


def residual(angle: float, lever: float) -> dict[str, float]:
    """The deviation ``angle`` rad of a joint's position as evidence, in the unit of its positions."""
    return {f"position_residual_{'rad' if lever == 1.0 else 'm'}": round(lever * angle, 4)}
