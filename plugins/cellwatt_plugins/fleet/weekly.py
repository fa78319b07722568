"""Computes the friction of each joint and the energy of each repetition in a week of a cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from threadpoolctl import threadpool_limits

from cellwatt.arrays import Float
from cellwatt.errors import CellwattError
from cellwatt_plugins.fleet.fitting import fit_joint, links_of
from cellwatt_plugins.fleet.lake import CellWeek, Skipped
from cellwatt_plugins.fleet.reading import Stretch, read_stretches
from cellwatt_plugins.fleet.repetitions import Span, at_work, signature, spans_of
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.regression import Prior

RATE: Final = 25.0
"""Rate of the fitted samples, Hz."""
MOST: Final = 20_000
"""Most fitted samples of a week, taken as whole repetitions evenly over the week."""


@dataclass(frozen=True)
class Repetition:
    """One repetition, or one piece of a recording; (n,) by joint, NaN if a joint hardly moved.

    ``recording`` is the number of its recording within the week, ``friction`` is relative to the week's,
    ``temperature`` °C; ``energy`` J is None without power, and for pieces.
    """

    recording: int
    signature: tuple[float, ...]
    friction: Float
    temperature: Float | None
    energy: float | None


@dataclass(frozen=True)
class Week:
    """One cell in one week: friction (n,) ``coulomb`` Nm and ``viscous`` Nm s/rad, from ``seconds`` of recordings.

    ``speed`` (n,) rad/s is the mean velocity while a joint slides.
    """

    cell: str
    week: int
    coulomb: Float
    viscous: Float
    speed: Float
    repetitions: tuple[Repetition, ...]
    skipped: tuple[Skipped, ...]
    seconds: float


@dataclass(frozen=True)
class _Part:
    """A repetition with its samples."""

    recording: int
    stretch: Stretch
    span: Span

    def rows(self) -> slice:
        return slice(self.span.first, self.span.last, max(1, round(1 / (self.stretch.step * RATE))))


def week_of_cell(item: CellWeek) -> Week:
    """Read and fit a week of a cell; unreadable recordings are listed in ``skipped``."""
    with threadpool_limits(1):
        arm = _arm(item.robot)
        parts, skipped = _parts(item, arm)
        return _fitted(item, arm, parts, skipped)


@lru_cache(maxsize=32)
def _arm(robot: Path) -> Arm:
    return Arm.load(robot)


@lru_cache(maxsize=32)
def _priors(robot: Path) -> list[Prior]:
    return links_of(_arm(robot))


def _parts(item: CellWeek, arm: Arm) -> tuple[list[_Part], list[Skipped]]:
    """Repetitions of the recordings, chosen evenly over the week until there are enough samples."""
    parts: list[_Part] = []
    skipped: list[Skipped] = []
    room = MOST
    for number in _spread(len(item.files)):
        if room <= 0:
            break
        path = item.files[number]
        try:
            found = read_stretches(path, arm)
        except CellwattError as error:
            skipped.append(Skipped.of(item.cell, path, error))
            continue
        each = [_Part(number, stretch, span) for stretch in found for span in spans_of(stretch)]
        share = max(room // min(4, len(item.files)), 1)
        for i in _spread(len(each)):
            used = len(range(*each[i].rows().indices(len(each[i].stretch.time))))
            if share > 0:
                parts.append(each[i])
            share, room = share - used, room - used * (share > 0)
    return sorted(parts, key=lambda part: (part.recording, part.stretch.time[0], part.span.first)), skipped


def _spread(count: int) -> list[int]:
    """Indices 0 … count - 1 in an order in which each is far from the ones before it."""
    width = max(1, (count - 1).bit_length())
    turned = (int(f"{i:0{width}b}"[::-1], 2) for i in range(1 << width))
    return [i for i in turned if i < count]


def _fitted(item: CellWeek, arm: Arm, parts: Sequence[_Part], skipped: list[Skipped]) -> Week:
    n = arm.joints
    if not parts:
        none = np.full(n, np.nan)
        return Week(item.cell, item.week, none, none, none, (), tuple(skipped), 0.0)
    q, qd, qdd, torque = (
        np.concatenate([getattr(part.stretch, name)[part.rows()] for part in parts])
        for name in ("position", "velocity", "acceleration", "torque")
    )
    ends = np.cumsum([len(part.stretch.time[part.rows()]) for part in parts])
    regressor, priors = arm.body.regressor(q, qd, qdd), _priors(item.robot)
    joints = [
        fit_joint(arm, i, priors[i], regressor[:, i, PER_LINK * i :], qd[:, i], qdd[:, i], torque[:, i], ends)
        for i in range(n)
    ]
    friction = np.column_stack([j.friction for j in joints])
    repetitions = tuple(_repetition(part, own) for part, own in zip(parts, friction, strict=True))
    coulomb, viscous, speed = (np.array([getattr(j, key) for j in joints]) for key in ("coulomb", "viscous", "speed"))
    seconds = sum((part.span.last - part.span.first) * part.stretch.step for part in parts)
    return Week(item.cell, item.week, coulomb, viscous, speed, repetitions, tuple(skipped), float(seconds))


def _repetition(part: _Part, friction: Float) -> Repetition:
    stretch, span = part.stretch, part.span
    energy = None
    if span.whole and stretch.power is not None:
        first, last = at_work(stretch, span)
        energy = float(stretch.power[first:last].sum() * stretch.step)
    return Repetition(part.recording, signature(stretch, span), friction, stretch.temperature, energy)
