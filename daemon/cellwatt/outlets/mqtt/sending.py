"""Sends messages in order, several on their way at a time, and notes in the same order which have arrived."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Coroutine, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from cellwatt.outlets.mqtt.link import WINDOW, Link
from cellwatt.outlets.mqtt.message import Message

FENCE_EVERY: Final = 1.0
"""s between two questions whether the broker has what it does not confirm by itself …"""
FENCE_AFTER: Final = 200
"""… and rows or results after which it is asked at the latest."""


@dataclass(frozen=True, slots=True)
class Parcel:
    """What is to be done once some messages have arrived, and, where they may not have, to send them again."""

    arrived: Callable[[], None]
    back: Callable[[], None] | None = None


class Sending:
    """Messages on their way over a link."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._room = asyncio.Semaphore(WINDOW)
        self._pending: deque[tuple[asyncio.Task[None] | None, Sequence[Parcel]]] = deque()
        self._more = asyncio.Event()
        self._unsure: list[Parcel] = []
        self._broken: Parcel | None = None
        """What was handed over in part when we were cancelled."""
        self._fenced_at = time.monotonic()

    @property
    def unsure(self) -> bool:
        """True if there is something of which nobody knows whether it arrived, and nobody was asked."""
        return bool(self._unsure)

    async def send(self, messages: Sequence[Message], parcel: Parcel | None = None) -> None:
        """Hand messages to the link; the parcel is noted once they, and all before them, have arrived."""
        confirmed = messages[-1].qos > 0 if messages else not self._unsure
        try:
            for i, message in enumerate(messages):
                last = parcel is not None and confirmed and i == len(messages) - 1
                await self._put(self._link.publish(message), [parcel] if last and parcel else ())
            if not messages and parcel is not None and confirmed:
                await self._put(None, [parcel])
        except asyncio.CancelledError:
            self._broken = parcel
            raise
        if parcel is not None and not confirmed:
            self._unsure.append(parcel)
            if len(self._unsure) >= FENCE_AFTER:
                await self.fence()

    async def fence(self, *, due: bool = False) -> None:
        """Ask whether the broker has what was sent so far; ``due``: only if it was not asked for a while."""
        now = time.monotonic()
        if self._unsure and not (due and now - self._fenced_at < FENCE_EVERY):
            self._fenced_at = now
            parcels, self._unsure = self._unsure, []
            try:
                await self._put(self._link.fence(), parcels)
            except asyncio.CancelledError:
                self._unsure = parcels
                raise

    async def _put(self, sending: Coroutine[None, None, None] | None, parcels: Sequence[Parcel]) -> None:
        try:
            await self._room.acquire()
        except asyncio.CancelledError:
            if sending is not None:
                sending.close()
            raise
        self._pending.append((None if sending is None else asyncio.ensure_future(sending), parcels))
        self._more.set()

    async def confirm(self) -> None:
        """Note what arrives, until cancelled. Raises ``MqttError`` for what does not."""
        while True:
            await self.arrive()
            await self._more.wait()

    async def arrive(self) -> None:
        """Note what arrives, until nothing is on its way. Raises ``MqttError`` for what does not."""
        while self._pending:
            task, parcels = self._pending[0]
            if task is not None:
                await asyncio.shield(task)
            self._pending.popleft()
            self._room.release()
            _note(parcels)
        self._more.clear()

    async def end(self) -> None:
        """Note what has arrived; give back the rest."""
        tasks = [task for task, _ in self._pending if task is not None]
        while self._pending:
            task, parcels = self._pending[0]
            if task is not None and (not task.done() or task.cancelled() or task.exception() is not None):
                break
            self._pending.popleft()
            _note(parcels)
        left = [*(parcel for _, parcels in self._pending for parcel in parcels), *self._unsure]
        left += [] if self._broken is None else [self._broken]
        self._pending.clear()
        self._unsure.clear()
        for parcel in reversed(left):
            if parcel.back is not None:
                parcel.back()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _note(parcels: Iterable[Parcel]) -> None:
    for parcel in parcels:
        parcel.arrived()
