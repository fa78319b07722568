"""The arithmetic of docs/capacity.md: cells a router carries. Pure; measures nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

DAY = 86_400.0  # s
MB = 1e6


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
