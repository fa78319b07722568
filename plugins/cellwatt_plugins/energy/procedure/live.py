"""The running cell as the guide sees it: the analyzer's values and the arm's joints, from the bus."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cellwatt.batch import Batch
from cellwatt.config import load
from cellwatt.errors import ConfigError
from cellwatt.outlets.zenoh.reach import link_to
from cellwatt.subscriber import LinkSettings, Subscriber
from cellwatt_plugins.energy.procedure.recorded import POWER

Float = NDArray[np.float64]


class Feed(Protocol):
    """Access to a cell that a reading needs."""

    def take(self, seconds: float) -> None:
        """Wait for what comes, so long at most."""
        ...

    @property
    def time(self) -> NDArray[np.int64]:
        """(N,) UTC ns of the analyzer's values since the feed was opened."""
        ...

    @property
    def power(self) -> Float:
        """(N,) W."""
        ...

    @property
    def joints(self) -> Float | None:
        """(n,) rad, the newest; None while the arm says nothing."""
        ...


@dataclass
class BusFeed:
    """A feed from the cell's raw topics; ``supply`` and ``source`` as in ``Recorded``."""

    subscriber: Subscriber
    supply: str | None = None
    source: str | None = None
    _time: list[int] = field(default_factory=list)
    _power: list[float] = field(default_factory=list)
    _joints: Float | None = None
    _from: set[str] = field(default_factory=set)

    def take(self, seconds: float) -> None:
        """See ``Feed.take``. Raises ``ConfigError`` where two sources give ``supply.power``."""
        try:
            content = self.subscriber.receive(seconds).content
        except TimeoutError:
            return
        if isinstance(content, Batch):
            self._take(content)

    def _take(self, batch: Batch) -> None:
        names = batch.stream.names
        if POWER in names and self.supply in (None, batch.source):
            self._from.add(batch.source)
            if len(self._from) > 1:
                raise ConfigError(f"{' and '.join(sorted(self._from))} both measure {POWER}: choose one with --supply")
            values = batch.values[:, names.index(POWER)]
            whole = np.isfinite(values)
            self._time += batch.time[whole].tolist()
            self._power += values[whole].tolist()
        if "joint_1.position" in names and self.source in (None, batch.source):
            columns = [i for i, name in enumerate(names) if name.startswith("joint_") and name.endswith(".position")]
            self._joints = np.asarray(batch.values[-1, columns])

    @property
    def time(self) -> NDArray[np.int64]:
        """See ``Feed.time``."""
        return np.array(self._time, np.int64)

    @property
    def power(self) -> Float:
        """See ``Feed.power``."""
        return np.array(self._power)

    @property
    def joints(self) -> Float | None:
        """See ``Feed.joints``."""
        return self._joints


@dataclass(frozen=True)
class Cell:
    """A running cell: where it is on the bus, and where it records."""

    site: str
    name: str
    link: LinkSettings
    record: Path

    @contextmanager
    def feed(self, supply: str | None, source: str | None) -> Iterator[BusFeed]:
        """Samples from now on. Raises ``OutletError`` where the link cannot be made."""
        with Subscriber(self.site, self.name, self.link, want=("raw",)) as subscriber:
            yield BusFeed(subscriber, supply, source)


def cell_of(file: Path) -> Cell:
    """The cell of a settings file. Raises ``ConfigError`` where it is not on the bus, or does not record."""
    config = load(file)
    link = link_to(config)
    if config.record is None:
        raise ConfigError(f"{file}: the cell does not record: add record: {{folder: …}}, runs are cut from it")
    return Cell(config.site, config.cell, link, config.record.folder)
