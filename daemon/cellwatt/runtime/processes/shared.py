"""Rings, assignments and messages that the processes of a daemon share."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Final

from cellwatt.channel import Stream
from cellwatt.clock.cell import CellClock
from cellwatt.config import CellConfig
from cellwatt.frames import Layout
from cellwatt.ring import Ring
from cellwatt.ring.memory import READERS
from cellwatt.runtime.allowance import USUAL

CHAINS: Final = 8
"""Most processes that judge; of more chains of stages some share one."""
SLOTS: Final = 2 * CHAINS
"""Processes that judge at a time: during a reload the old ones and the new."""
KEPT: Final = 10.0
"""s of data that a ring holds: how long a reader may stand still before it misses some."""
SMALLEST, LARGEST = 1 << 20, 64 << 20  # bytes of a ring
RESULTS: Final = 2 << 20
"""Bytes of results that a chain may be ahead of who records and publishes them."""

TELL, OTHERS, TOLD = 0, 1, READERS - 1
"""Readers of a ring: who tells, up to where that is in the record; the first of the others. Up to where it is told is a
position without a reader of its own."""
ALIGN = OTHERS
"""Reader of the raw ring who makes frames; chain number n reads the frames as ``OTHERS + n``."""
ALIGNS, TELLS = 0.0015, 0.003
"""s by which who makes frames, and who records and publishes, wake after who collects: in the order of the data."""
SAID: Final = 1.0
"""s between figures of a process that has something to do."""
ALARMS: Final = 2 << 20
"""Bytes of alarms and events that are kept for who tells next; of other results as much as ``RESULTS``."""


@dataclass(frozen=True, slots=True)
class Shared:
    """The cell's clock and session, and the rings: raw from *collect*, frames from *align*, results of each chain.

    ``told`` is the journal of who tells.
    """

    clock: CellClock
    session: int
    raw: Ring
    frames: Ring
    results: tuple[Ring, ...]
    told: tuple[Ring, Ring]

    @classmethod
    def of(cls, streams: Mapping[str, tuple[Stream, ...]], layout: Layout) -> Shared:
        """Rings that hold some seconds of what these streams and frames give."""
        clock = CellClock()
        raw = sum((s.rate or USUAL) * (60 + 10 * len(s.channels)) for its in streams.values() for s in its)
        frames = layout.rate * (50 + 19 * len(layout.channels))
        results = tuple(Ring(RESULTS, OTHERS) for _ in range(SLOTS))
        for ring in results:
            ring.end()
        told = Ring(ALARMS, 1), Ring(RESULTS, 1)
        return cls(clock, clock.now(), _ring(raw, OTHERS + 1), _ring(frames, OTHERS + SLOTS), results, told)


def _ring(rate: float, readers: int) -> Ring:
    """A ring for ``rate`` bytes a second, whose readers wake by themselves until they listen."""
    made = Ring(round(min(max(KEPT * rate, SMALLEST), LARGEST)), readers)
    for reader in range(readers):
        made.listen(reader, False)
    return made


@dataclass(frozen=True, slots=True)
class Assignment:
    """Task of one process: ``stages`` for a chain in ``slot``; ``held``: begin with what this generation brings.

    ``generation`` numbers the settings since the start, ``restarts`` how often the process was begun again.
    """

    shared: Shared
    config: CellConfig
    generation: int
    control: Connection
    restarts: int = 0
    stages: tuple[str, ...] = ()
    slot: int = 0
    held: bool = False


# What supervisor and processes say to each other -----------------------------------------------------


@dataclass(frozen=True, slots=True)
class Ready:
    """The process serves."""


@dataclass(frozen=True, slots=True)
class Failed:
    """The process cannot do its work, for a reason that a person can mend."""

    error: Exception


@dataclass(frozen=True, slots=True)
class InForce:
    """Everything works by the settings of this generation."""

    generation: int


@dataclass(frozen=True, slots=True)
class Apply:
    """Settings to be taken: at once where a process reads devices, at their ``Mark`` where it reads a ring."""

    generation: int
    config: CellConfig


@dataclass(frozen=True, slots=True)
class Alive:
    """The cell's health was looked at; ``status`` is one line about it for systemd."""

    status: str


@dataclass(frozen=True, slots=True)
class Stop:
    """Come to an end."""


def figures(part: str, assignment: Assignment, **more: Any) -> dict[str, Any]:
    """Figures that a process gives of itself about once a second."""
    return {
        "part": part,
        "pid": os.getpid(),
        "restarts": assignment.restarts,
        "cpu_s": round(time.process_time(), 2),
        **more,
    }
