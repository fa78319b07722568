"""Frames from a CAN bus through python-can, in blocks, without blocking the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from cellwatt.errors import ConnectError
from cellwatt_drivers.shared.aside import opened_aside
from cellwatt_drivers.shared.mailbox import Mailbox

if TYPE_CHECKING:
    from can import BusABC, Message

Interface = Literal["socketcan", "slcan"]

BLOCK = 0.005
"""s that frames wait for others, to be handed on together."""
MOST_WAITING = 20_000
"""Frames that wait for the driver; the oldest are dropped beyond it."""
_MOST_AT_ONCE = 256
"""Frames dealt with in one turn of the loop, so that other sources have theirs."""


@dataclass(frozen=True, slots=True)
class BusPlace:
    """A bus and what python-can wants to know to open it."""

    interface: Interface
    channel: str
    options: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.interface} {self.channel}"


class Listening(Mailbox["Message"]):
    """Frames of an open bus. ``latest`` is when the newest came, s of the loop's clock."""

    def __init__(self, place: BusPlace, bus: BusABC) -> None:
        super().__init__(MOST_WAITING)
        self.place = place
        self.latest = 0.0
        self._bus = bus
        self._loop = asyncio.get_running_loop()

    async def frames(self, seconds: float) -> list[Message]:
        """Return frames in order; after at most ``seconds``, then perhaps none. Raises ``ConnectError``."""
        return await self.given(seconds, _MOST_AT_ONCE, BLOCK)

    @property
    def malformed(self) -> int:
        """Lines of a serial adapter that were no frames."""
        return int(getattr(self._bus, "malformed", 0))

    def drain(self) -> None:
        """Take what the bus holds; called by the loop when its descriptor can be read."""
        try:
            for _ in range(_MOST_AT_ONCE):
                message = self._bus.recv(0)
                if message is None:
                    return
                self.take(message)
                self.latest = self._loop.time()
        except Exception as error:  # python-can, pyserial and the system each have their own
            self._loop.remove_reader(self._bus.fileno())
            self.fail(ConnectError(f"{self.place}: {error}"))


@asynccontextmanager
async def open_listening(place: BusPlace) -> AsyncIterator[Listening]:
    """Open a bus, in a thread because some adapters take their time. Raises ``ConnectError``."""
    async with opened_aside(lambda: _open(place), _close) as bus:
        listening, descriptor = Listening(place, bus), bus.fileno()
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
        return can.Bus(channel=place.channel, interface=place.interface, ignore_config=True, **place.options)
    except (can.CanError, OSError, ValueError, NotImplementedError) as error:
        raise ConnectError(f"{place} cannot be opened: {error}{_advice(place.interface)}") from error


def _advice(interface: Interface) -> str:
    if interface == "socketcan":
        return "; is it there and up? ip link set can0 up type can bitrate 500000"
    return "; is it the adapter's port, in a group of this user (dialout), and not in use?"


def _close(bus: BusABC) -> None:
    try:
        bus.shutdown()
    except Exception:  # an adapter that was unplugged cannot be closed in order
        return
