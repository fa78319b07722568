"""Frames from a CAN bus through python-can, in blocks, without blocking the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from cellwatt.errors import ConnectError
from cellwatt_drivers.shared.aside import opened_aside
from cellwatt_drivers.shared.mailbox import Mailbox

if TYPE_CHECKING:
    from can import BusABC, Message

Interface = Literal["socketcan", "slcan"]

BLOCK = 0.005
"""Time, s, for which frames wait to be handed over in one block."""
MOST_WAITING = 20_000
"""Most frames queued for the driver; the oldest of more are dropped."""
_MOST_AT_ONCE = 256
"""Most frames handled in one turn of the loop, so that other sources get their turn."""


@dataclass(frozen=True, slots=True)
class BusPlace:
    """A bus and python-can's options to open it."""

    interface: Interface
    channel: str
    options: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.interface} {self.channel}"


class Listening(Mailbox["Message"]):
    """Frames of an open bus. ``latest``: arrival of the newest frame by ``now``, the cell's time, ns."""

    def __init__(self, place: BusPlace, bus: BusABC, now: Callable[[], int]) -> None:
        super().__init__(MOST_WAITING)
        self.place = place
        self.latest = 0
        self._bus = bus
        self._now = now
        self._loop = asyncio.get_running_loop()

    async def frames(self, seconds: float) -> list[Message]:
        """Return frames in order; empty if none arrives within ``seconds``. Raises ``ConnectError``."""
        return await self.given(seconds, _MOST_AT_ONCE, BLOCK)

    @property
    def malformed(self) -> int:
        """Number of invalid lines from a serial adapter."""
        return int(getattr(self._bus, "malformed", 0))

    def drain(self) -> None:
        """Queue the frames that the bus holds; the loop calls this when the bus's descriptor is readable."""
        try:
            for _ in range(_MOST_AT_ONCE):
                message = self._bus.recv(0)
                if message is None:
                    return
                self.take(message)
                self.latest = self._now()
        except Exception as error:  # python-can, pyserial and the system raise different exceptions
            self._loop.remove_reader(self._bus.fileno())
            self.fail(ConnectError(f"{self.place}: {error}"))


@asynccontextmanager
async def open_listening(place: BusPlace, now: Callable[[], int]) -> AsyncIterator[Listening]:
    """Open a bus in a thread, because some adapters are slow to open. Raises ``ConnectError``."""
    async with opened_aside(lambda: _open(place), _close) as bus:
        listening, descriptor = Listening(place, bus, now), bus.fileno()
        loop = asyncio.get_running_loop()
        loop.add_reader(descriptor, listening.drain)
        try:
            yield listening
        finally:
            loop.remove_reader(descriptor)


def _open(place: BusPlace) -> BusABC:
    import can

    try:
        if place.interface == "slcan":
            from cellwatt_drivers.can_sensor.slcan import CountingSlcanBus

            return CountingSlcanBus(place.channel, **place.options)
        # With fd, the kernel passes classic and FD frames; without it, FD frames are dropped without notice.
        return can.Bus(channel=place.channel, interface=place.interface, ignore_config=True, fd=True, **place.options)
    except (can.CanError, OSError, ValueError, NotImplementedError) as error:
        raise ConnectError(f"{place} cannot be opened: {error}{_advice(place.interface)}") from error


def _advice(interface: Interface) -> str:
    if interface == "socketcan":
        return "; does it exist, and is it up? ip link set can0 up type can bitrate 500000"
    return "; is it the adapter's port, in a group of this user (dialout), and not in use?"


def _close(bus: BusABC) -> None:
    with suppress(Exception):  # an unplugged adapter cannot be closed properly
        bus.shutdown()
