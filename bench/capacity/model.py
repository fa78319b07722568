"""The arithmetic of docs/capacity.md: cells a router carries, and what a lake costs. Pure; measures nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

DAY = 86_400.0  # s
DAYS = 365
MONTHS = 12
MB, GB = 1e6, 1e9


@dataclass(frozen=True, slots=True)
class Traffic:
    """What one cell gives to a router: messages a second and their payload, bytes a second."""

    messages: float
    bytes: float

    def __add__(self, other: Traffic) -> Traffic:
        return Traffic(self.messages + other.messages, self.bytes + other.bytes)


@dataclass(frozen=True, slots=True)
class Forwarding:
    """Processor time of a router, s: for each message and each MB of payload that come in, and that go out."""

    message_in: float
    message_out: float
    mb_in: float
    mb_out: float

    def cores(self, traffic: Traffic, readers: float) -> float:
        """Cores that are busy with the traffic, each message of which goes to ``readers``.

        A message that nobody wants does not leave its cell: without readers it is 0.
        """
        if readers <= 0:
            return 0.0
        messages = self.message_in + readers * self.message_out
        return traffic.messages * messages + traffic.bytes / MB * (self.mb_in + readers * self.mb_out)


@dataclass(frozen=True, slots=True)
class Load:
    """A measured load of a router: what came in a second, how many read each message, and the cores it took."""

    traffic: Traffic
    readers: int
    cores: float


def fitted(loads: Sequence[Load]) -> Forwarding:
    """The costs that fit measured loads best, relative to each; none is negative. Raises ``ValueError`` below four."""
    from scipy.optimize import nnls

    if len(loads) < 4:
        raise ValueError(f"found {len(loads)} loads, expected at least four")
    rows = [
        [x.traffic.messages, x.traffic.messages * x.readers, x.traffic.bytes / MB, x.traffic.bytes / MB * x.readers]
        for x in loads
    ]
    weights = 1.0 / np.array([x.cores for x in loads])
    found, _ = nnls(np.array(rows) * weights[:, None], np.ones(len(loads)))
    return Forwarding(*(float(x) for x in found))


def most_cells(cores_a_cell: float, cores: float = 1.0, headroom: float = 0.5) -> int:
    """Cells that fit so that ``headroom`` of ``cores`` stays free. Raises ``ValueError`` where a cell takes nothing."""
    if cores_a_cell <= 0 or not 0 <= headroom < 1:
        raise ValueError(f"found {cores_a_cell} cores a cell and headroom {headroom}")
    return math.floor(cores * (1 - headroom) / cores_a_cell * (1 + 1e-12))


PART_OF_AN_UPLOAD = 10 * 2**20
"""Bytes of a part, as Arrow uploads what is larger than one."""
GETS_OF_A_READ = 3
"""Requests, HEAD and GET, with which the historian reads a file of S3 back."""
LISTS_OF_A_JOIN = 2
READS_OF_A_JOIN = 2
"""How often each file is read when those of a day are joined."""
PUTS_OF_A_REMOVAL, GETS_OF_A_REMOVAL = 1, 1
"""Beside the DELETE, which costs nothing: Arrow looks for the file, and writes a mark for its folder."""


def puts(size: float) -> float:
    """Requests that cost as much as a PUT, to write a file of ``size`` bytes: one, or its parts and two more."""
    return 1.0 if size <= PART_OF_AN_UPLOAD else 2.0 + math.ceil(size / PART_OF_AN_UPLOAD)


@dataclass(frozen=True, slots=True)
class Lake:
    """What one cell writes into a lake on one day: ``bytes`` in ``files``; with ``compact`` these become one."""

    bytes: float
    files: float
    compact: bool = False

    @property
    def writing(self) -> float:
        """Requests a day that cost as much as a PUT: those, LIST, and parts of uploads."""
        written = self.files * puts(self.bytes / self.files)
        return written + (puts(self.bytes) + LISTS_OF_A_JOIN + self.files * PUTS_OF_A_REMOVAL if self.compact else 0.0)

    @property
    def joining(self) -> float:
        """Requests a day that cost as much as a GET, to join the files of a day."""
        return self.files * (READS_OF_A_JOIN * GETS_OF_A_READ + GETS_OF_A_REMOVAL) if self.compact else 0.0

    @property
    def kept(self) -> float:
        """Files of a day that stay."""
        return 1.0 if self.compact else self.files


@dataclass(frozen=True, slots=True)
class Reading:
    """What is read of a lake: ``cell_days`` a day, of which ``share`` of the bytes are transferred.

    ``gets_a_file`` requests open a file and fetch one column of it; ``outside`` is the share of the bytes that leaves
    the provider's network. ``core_hours`` a cell and day are those of commands over the lake, measured elsewhere.
    """

    cell_days: float = 0.0
    share: float = 1.0
    gets_a_file: float = 3.0
    outside: float = 1.0
    core_hours: float = 0.0


@dataclass(frozen=True, slots=True)
class Prices:
    """List prices in one currency; ``docs/capacity.md`` says whose and of when."""

    gb_month: float
    puts_1000: float
    gets_1000: float
    egress_gb: float
    core_hour: float = 0.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of a year by kind."""

    storage: float
    put: float
    get: float
    egress: float
    compute: float

    @property
    def total(self) -> float:
        """All of it."""
        return self.storage + self.put + self.get + self.egress + self.compute


def stored_gb_months(cells: int, lake: Lake, kept_days: float = DAYS, age_days: float = 0.0) -> float:
    """GB-months of a year that begins ``age_days`` after the lake was begun, of which ``kept_days`` are kept.

    What is there grows evenly until it is as old as it is kept, then it stays.
    """
    daily = cells * lake.bytes / GB
    return daily * _integral(age_days, age_days + DAYS, kept_days) * MONTHS / DAYS


def _integral(begin: float, end: float, most: float) -> float:
    """Of ``min(t, most)`` from ``begin`` to ``end``."""

    def until(t: float) -> float:
        return t * t / 2 if t <= most else most * most / 2 + (t - most) * most

    return until(end) - until(begin)


def year(
    cells: int, lake: Lake, reading: Reading, prices: Prices, kept_days: float = DAYS, age_days: float = 0.0
) -> Cost:
    """What ``cells`` cost in the year that begins ``age_days`` after the lake was begun."""
    read = reading.cell_days * DAYS
    gets = cells * lake.joining * DAYS + read * lake.kept * reading.gets_a_file
    return Cost(
        storage=stored_gb_months(cells, lake, kept_days, age_days) * prices.gb_month,
        put=cells * lake.writing * DAYS / 1000 * prices.puts_1000,
        get=gets / 1000 * prices.gets_1000,
        egress=read * lake.bytes / GB * reading.share * reading.outside * prices.egress_gb,
        compute=cells * reading.core_hours * DAYS * prices.core_hour,
    )
