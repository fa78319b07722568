"""Polls of a device that answers one request at a time: delivered samples, failure reasons, reconnecting."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any, ClassVar, Final, NoReturn

import numpy as np

from cellwatt.arrays import Float
from cellwatt.batch import Reading
from cellwatt.channel import Quality, Stream
from cellwatt.driver import Driver, Inlet
from cellwatt.errors import ConnectError, DeviceError, ProtocolError, SourceError

_SHORTEST: Final = 0.25
"""Shortest time between two connections, s: a device that fails at once must not be flooded with them."""


class NoAnswerError(ConnectError):
    """No answer arrived in time; a late one could be mistaken for the answer to the next request."""

    reason: ClassVar[str] = "timeout"
    """Reason under which the account counts the poll."""


def reason_of(error: SourceError) -> str:
    """Return the reason under which the account counts a poll that failed with this error."""
    if isinstance(error, NoAnswerError):
        return error.reason
    if isinstance(error, ConnectError):
        return "connection lost"
    return "device error" if isinstance(error, DeviceError) else "malformed"


def deliver(
    inlet: Inlet, stream: Stream, values: Float, asked: int, arrival: int, quality: Quality = Quality.GOOD
) -> None:
    """Count and hand over one sample (channels,), requested and received at these times of the cell, ns.

    A ``LATE`` one was counted when it was due.
    """
    inlet.account.expect(quality is not Quality.LATE)
    flags = np.array([quality], dtype=np.uint8)
    inlet.emit(Reading(stream, values.reshape(1, -1), arrival, asked=asked, quality=flags))


async def keep_conversing(driver: Driver[Any], converse: Callable[[], Awaitable[None]]) -> NoReturn:
    """Open one connection after the other, as long as each one delivers samples.

    Raises the ``ConnectError`` or ``ProtocolError`` that ended a connection without a sample, and every other error.
    """
    account = driver.inlet.account
    while True:
        before, began = account.expected - account.missed.total(), time.monotonic()
        try:
            await converse()
        except (ConnectError, ProtocolError) as error:
            if account.expected - account.missed.total() == before:
                raise
            account.count("reconnects")
            driver.inlet.event("reopened", f"{driver.name}: {error}; the connection is opened again")
            await asyncio.sleep(began + _SHORTEST - time.monotonic())
