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
"""Largest number of *judge* processes; more chains of stages share processes."""
SLOTS: Final = 2 * CHAINS
"""Largest number of *judge* processes during a reload, when old and new ones run."""
HELD: Final = 10.0
"""s of data that a ring holds: longest time for which a reader may stall without losing data."""
SMALLEST, LARGEST = 1 << 20, 64 << 20  # bytes of a ring
RESULTS: Final = 2 << 20
"""Bytes of a chain's results that may wait for *tell*."""

TELL, OTHERS, PUBLISHED = 0, 1, READERS - 1
"""Readers of a ring: *tell*, whose position is the end of the recorded items; the first of the others; and a position
without a reader, the end of the published items."""
ALIGN = OTHERS
"""Number of *align* as reader of the raw ring; chain number n reads the frames as ``OTHERS + n``."""
ALIGNS, TELLS = 0.0015, 0.003
"""s by which *align* and *tell* wake later than *collect*: in the order of the data."""
REPORT_EVERY: Final = 1.0
"""Period in s at which a busy process reports its figures."""
ALARMS: Final = 2 << 20
"""Bytes of alarms and events stored for a successor of *tell*; ``RESULTS`` for other results."""


@dataclass(frozen=True, slots=True)
class Shared:
    """The cell's clock and session, and the rings: raw from *collect*, frames from *align*, results of each chain.

    ``journal`` is that of *tell*.
    """

    clock: CellClock
    session: int
    raw: Ring
    frames: Ring
    results: tuple[Ring, ...]
    journal: tuple[Ring, Ring]

    @classmethod
    def of(cls, streams: Mapping[str, tuple[Stream, ...]], layout: Layout) -> Shared:
        """Rings for some seconds of these streams and frames."""
        clock = CellClock()
        raw, frames = rates(streams, layout)
        results = tuple(Ring(RESULTS, OTHERS) for _ in range(SLOTS))
        for ring in results:
            ring.end()
        journal = Ring(ALARMS, 1), Ring(RESULTS, 1)
        return cls(clock, clock.now(), _ring(raw, OTHERS + 1), _ring(frames, OTHERS + SLOTS), results, journal)


def rates(streams: Mapping[str, tuple[Stream, ...]], layout: Layout) -> tuple[float, float]:
    """Bytes of samples, and of frames, per second."""
    samples = sum((s.rate or USUAL) * (60 + 10 * len(s.channels)) for its in streams.values() for s in its)
    return samples, layout.rate * (50 + 19 * len(layout.channels))


def _ring(rate: float, readers: int) -> Ring:
    """A ring for ``rate`` bytes a second; its readers poll until they listen."""
    made = Ring(round(min(max(HELD * rate, SMALLEST), LARGEST)), readers)
    for reader in range(readers):
        made.listen(reader, False)
    return made


@dataclass(frozen=True, slots=True)
class Assignment:
    """Task of one process: ``stages`` for a chain in ``slot``; ``held``: wait for the first frames of ``generation``.

    ``generation`` numbers the settings since the start, ``restarts`` counts the restarts of the process.
    """

    shared: Shared
    config: CellConfig
    generation: int
    control: Connection
    restarts: int = 0
    stages: tuple[str, ...] = ()
    slot: int = 0
    held: bool = False


# Messages between supervisor and processes -----------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Ready:
    """The process has started."""


@dataclass(frozen=True, slots=True)
class Failed:
    """The process cannot start, for a reason that a person can remedy."""

    error: Exception


@dataclass(frozen=True, slots=True)
class InForce:
    """The settings sent last are in force."""


@dataclass(frozen=True, slots=True)
class Apply:
    """New settings: *collect* applies them at once, a process that reads a ring at their ``Mark``."""

    generation: int
    config: CellConfig


@dataclass(frozen=True, slots=True)
class Refused:
    """The settings file was changed and is not in force, for this first reason; empty: it is in force again."""

    reason: str


@dataclass(frozen=True, slots=True)
class Alive:
    """The cell's health was checked; ``status`` is one line about it for systemd.

    ``hung``: numbers of the processes that have not responded for so long that they must be killed.
    """

    status: str
    hung: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Stop:
    """End in order."""


def figures(part: str, assignment: Assignment, **more: Any) -> dict[str, Any]:
    """Figures that a process reports about itself, about once a second."""
    return {
        "part": part,
        "pid": os.getpid(),
        "restarts": assignment.restarts,
        "cpu_s": round(time.process_time(), 2),
        **more,
    }
