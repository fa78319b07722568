"""The queue between the event loop and the publishing thread."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final

from cellwatt.account import Account
from cellwatt.batch import Batch
from cellwatt.frames import concatenate, follows
from cellwatt.outlet import Item
from cellwatt.outlets.zenoh.mark import Mark

_MERGED: Final = 1024
"""Most samples of one stream that go into one message when the publisher is behind."""


class Lane(IntEnum):
    """Priority of an item: the first lane goes out first and is dropped last."""

    RESULTS = 0
    FRAMES = 1
    RAW = 2


@dataclass(frozen=True, slots=True)
class Outgoing:
    """An item to publish: ``topic`` is its numbering, ``paths`` are its keys within the cell."""

    topic: str
    paths: tuple[str, ...]
    item: Item
    mark: Mark


class Outbox:
    """At most ``limit`` items from one thread to another.

    A full outbox drops the oldest raw batch, then the oldest frames, and only then a result; each loss is counted in
    ``account``, in samples, under ``queue: raw``, ``queue: frames`` or ``queue: results``. Raw batches of a stream
    that wait together leave as one message. An item enters the account when it was sent or lost, so the account never
    has a residue.
    """

    def __init__(self, limit: int, account: Account) -> None:
        self._limit = limit
        self._account = account
        self._lock = threading.Condition(threading.Lock())
        self._idle = False
        self._lanes: tuple[dict[str, deque[Outgoing]], ...] = ({}, {}, {})
        """What waits in each lane: raw batches by topic, others under one name in the order in which they came."""
        self._ends: dict[str, tuple[int, int]] = {}
        self._waiting = 0
        self._woken = False

    def put(self, lane: Lane, outgoing: Outgoing, *, wake: bool = True) -> None:
        """Add an item; never blocks. Without ``wake`` the caller must take it with ``take_samples``."""
        with self._lock:
            self._ends[outgoing.topic] = (outgoing.mark.session, outgoing.mark.end)
            while self._waiting >= self._limit:
                self._drop_oldest()
            stream = outgoing.topic if lane is Lane.RAW else ""
            self._lanes[lane].setdefault(stream, deque()).append(outgoing)
            self._waiting += 1
            if wake:
                self._lock.notify()

    def wake(self) -> None:
        """Make the ``take`` that runs now, or the next one that would wait, return."""
        with self._lock:
            self._woken = True
            self._lock.notify()

    @property
    def idle(self) -> bool:
        """True while the taking thread waits for an item."""
        return self._idle

    def take_samples(self) -> Outgoing | None:
        """Take the next samples or frames if the taking thread is idle and no result waits; never blocks.

        The caller can send them itself without a change of threads, and the order of a topic is kept.
        """
        with self._lock:
            return self._next() if self._idle and self._waiting and not self._lanes[Lane.RESULTS] else None

    def take(self) -> Outgoing | None:
        """Take the next item, or ``None`` after ``wake`` if none waits. Blocks until either; for one thread."""
        with self._lock:
            self._idle = True
            self._lock.wait_for(lambda: self._waiting or self._woken)
            self._idle = False
            if self._waiting:
                return self._next()
            self._woken = False
            return None

    def sent(self, outgoing: Outgoing) -> None:
        """Count a taken item as sent."""
        with self._lock:
            self._account.expect(outgoing.mark.count)
            self._account.receive(outgoing.mark.count)

    def lost(self, outgoing: Outgoing, where: str) -> None:
        """Count a taken item as lost."""
        with self._lock:
            self._drop(outgoing, where)

    def positions(self) -> dict[str, tuple[int, int]]:
        """Session and the number up to which everything was sent or lost, by topic."""
        with self._lock:
            found = dict(self._ends)
            for outgoing in reversed(list(self._all())):
                found[outgoing.topic] = (outgoing.mark.session, outgoing.mark.sequence)
            return found

    def clear(self, where: str) -> None:
        """Drop and count all waiting items."""
        with self._lock:
            for outgoing in self._all():
                self._drop(outgoing, where)
            for lane in self._lanes:
                lane.clear()
            self._waiting = 0

    def count(self, what: str, n: int = 1) -> None:
        """Count anything else in the account, from any thread."""
        with self._lock:
            self._account.count(what, n)

    def __len__(self) -> int:
        return self._waiting

    def _all(self) -> Iterator[Outgoing]:
        return (outgoing for lane in self._lanes for waiting in lane.values() for outgoing in waiting)

    def _next(self) -> Outgoing:
        lane = next(lane for lane in self._lanes if lane)
        stream, waiting = next(iter(lane.items()))
        together = [waiting.popleft()]
        while waiting and _fits(together, waiting[0]):
            together.append(waiting.popleft())
        del lane[stream]
        if waiting:
            lane[stream] = waiting  # behind the other streams
        self._waiting -= len(together)
        return _merged(together)

    def _drop_oldest(self) -> None:
        lane = max(lane for lane in Lane if self._lanes[lane])
        streams = self._lanes[lane]
        stream = min(streams, key=lambda name: streams[name][0].mark.arrival)
        self._drop(streams[stream].popleft(), f"queue: {lane.name.lower()}")
        if not streams[stream]:
            del streams[stream]
        self._waiting -= 1

    def _drop(self, outgoing: Outgoing, where: str) -> None:
        self._account.expect(outgoing.mark.count)
        self._account.drop(outgoing.mark.count, where)


def _fits(together: list[Outgoing], second: Outgoing) -> bool:
    first = together[-1].item
    if not isinstance(first, Batch) or not isinstance(second.item, Batch) or not follows(first, second.item):
        return False
    return second.mark.end - together[0].mark.sequence <= _MERGED


def _merged(together: list[Outgoing]) -> Outgoing:
    """Merge consecutive items of one topic into one."""
    if len(together) == 1:
        return together[0]
    batch = concatenate([o.item for o in together if isinstance(o.item, Batch)])
    mark = replace(together[0].mark, count=len(batch), arrival=batch.arrival)
    return replace(together[0], item=batch, mark=mark)
