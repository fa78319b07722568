"""All channels of a cell on one time grid; and blocks of samples or frames joined and cut by sequence number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import joined, rows_of
from cellwatt.batch import Batch
from cellwatt.channel import Align, Kind
from cellwatt.errors import ConfigError


@dataclass(frozen=True, slots=True)
class FrameChannel:
    """A column of the frames: ``name`` is ``<source>.<channel>``, e.g. ``arm.joint_1.position``.

    ``window`` is the time in s over which the device averages each value, as in ``Channel``.
    """

    name: str
    unit: str
    kind: Kind
    method: Align
    window: float = 0.0

    @property
    def source(self) -> str:
        """The source's name in the settings file."""
        return self.name.split(".", 1)[0]

    @property
    def short(self) -> str:
        """The channel's name within its source."""
        return self.name.split(".", 1)[1]


@dataclass(frozen=True)
class Layout:
    """The columns of a cell's frames and their grid: ``rate`` in Hz; grid points are multiples of 1/rate in UTC."""

    channels: tuple[FrameChannel, ...]
    rate: float

    @cached_property
    def step(self) -> int:
        """Grid step, ns."""
        return round(1e9 / self.rate)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Full names in column order."""
        return tuple(c.name for c in self.channels)

    def index(self, name: str, unit: str | None = None) -> int:
        """Column of a channel given by full name, or by short name if only one source has it.

        Raises ``ConfigError``, with the candidates, if the name is unknown or ambiguous, or the unit is not ``unit``.
        """
        found = [i for i, c in enumerate(self.channels) if c.name == name]
        found = found or [i for i, c in enumerate(self.channels) if c.short == name]
        if not found:
            raise ConfigError(f"no source has the channel {name!r}; available: {', '.join(self.names)}")
        if len(found) > 1:
            options = ", ".join(self.names[i] for i in found)
            raise ConfigError(f"several sources have the channel {name!r}: write one of {options}")
        channel = self.channels[found[0]]
        if unit not in (None, channel.unit):
            raise ConfigError(f"channel {channel.name} is in {channel.unit}, expected {unit}")
        return found[0]

    def joints(self, quantity: str, source: str | None = None) -> tuple[int, ...]:
        """Columns of ``joint_1.<quantity>``, ``joint_2.<quantity>``, … of ``source``, or of the only one with joints.

        Raises ``ConfigError`` if no source has joints, or if several have and ``source`` is None.
        """
        sources = sorted({c.source for c in self.channels if c.short == f"joint_1.{quantity}"})
        if source is None and not sources:
            raise ConfigError(f"no source has joint_1.{quantity}")
        if source is None and len(sources) > 1:
            raise ConfigError(f"several sources have joints: choose one of {', '.join(sources)}")
        source = sources[0] if source is None else source
        if source not in sources:
            raise ConfigError(f"source {source!r} has no joint_1.{quantity}; these have: {', '.join(sources)}")
        columns: list[int] = []
        while (name := f"{source}.joint_{len(columns) + 1}.{quantity}") in self.names:
            columns.append(self.names.index(name))
        return tuple(columns)


@dataclass(frozen=True, slots=True)
class Frames:
    """n neighbouring points of the grid.

    ``time`` (n,) ns UTC; ``values`` (n, channels), NaN where missing; ``quality`` (n, channels);
    ``bound`` (n, channels) ns: largest time difference between value and grid point (clock bound plus
    distance to the samples used). ``sequence`` numbers the first frame of the block within the session.
    """

    layout: Layout
    sequence: int
    time: NDArray[np.int64]
    values: NDArray[np.float64]
    quality: NDArray[np.uint8]
    bound: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.time)

    def stamps(self, column: int) -> NDArray[np.int64]:
        """Time stamps (n,) of the values of a held column, ns UTC, without clock bound: a new value has a new stamp."""
        return self.time - self.bound[:, column]


Block = TypeVar("Block", bound=Batch | Frames)


def join(blocks: Sequence[Block], limit: int) -> Block | None:
    """Join the first blocks, up to the first gap in their numbering and at most ``limit`` samples."""
    taken: list[Block] = []
    count = 0
    for block in blocks:
        if count >= limit or (taken and not follows(taken[-1], block)):
            break
        taken.append(block)
        count += len(block)
    return cut(concatenate(taken), 0, limit) if taken else None


def follows(first: Block, second: Block) -> bool:
    """True if ``second`` continues ``first`` without a gap, with the same stream or layout."""
    if isinstance(first, Batch) and isinstance(second, Batch):
        same = first.stream == second.stream and (first.device_time is None) == (second.device_time is None)
    else:
        same = isinstance(first, Frames) and isinstance(second, Frames) and first.layout == second.layout
    return same and second.sequence == first.sequence + len(first)


def concatenate(blocks: Sequence[Block]) -> Block:
    """Join consecutive blocks; a batch gets the ``arrival`` of the last one."""
    if len(blocks) == 1:
        return blocks[0]
    changed: dict[str, Any] = {"arrival": blocks[-1].arrival} if isinstance(blocks[-1], Batch) else {}
    return replace(joined(blocks), **changed)


def cut(content: Block, first: int, last: int) -> Block:
    """Rows ``first`` … ``last`` (excluded) of a block, with the sequence number adapted."""
    if first <= 0 and last >= len(content):
        return content
    first = max(first, 0)
    return replace(rows_of(content, slice(first, last)), sequence=content.sequence + first)
