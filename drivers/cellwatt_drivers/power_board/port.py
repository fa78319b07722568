"""A serial port that is only read; the only module of this driver with I/O."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import serial

from cellwatt import ConnectError
from cellwatt.gather import next_moment
from cellwatt_drivers.shared.aside import opened_aside
from cellwatt_drivers.shared.serial_port import open_port

MOST_READ = 4096
"""Most bytes handled in one turn of the loop, so that other sources get their turn."""
ADAPTERS = Path("/sys/bus/usb-serial/devices")


class ListeningPort:
    """An open port, created by ``listening_port``. It has no way to write.

    ``latency``: time, ms, for which the adapter buffers bytes; None if unknown.
    """

    def __init__(self, device: serial.Serial) -> None:
        self._path = str(device.port)
        self._device = device
        self.latency = _latency_timer(self._path)

    def close(self) -> None:
        """Close the port; blocks."""
        self._device.close()

    async def read(self, seconds: float, now: Callable[[], int], gather: float) -> list[tuple[bytes, int]]:
        """Return bytes received until the next gather time of ``gather`` s, in pieces with their arrival by ``now``.

        Empty if nothing arrives within ``seconds``. Raises ``ConnectError`` when the port is gone.
        """
        loop = asyncio.get_running_loop()
        descriptor = self._device.fileno()
        came: list[tuple[bytes, int]] = []
        done: asyncio.Future[None] = loop.create_future()

        def take() -> None:
            try:
                came.append((self._read(descriptor), now()))
            except BlockingIOError:
                return
            except ConnectError as error:  # earlier bytes are returned first: the next call raises the error
                loop.remove_reader(descriptor)
                if not came:
                    done.set_exception(error)
                return
            if len(came) == 1:
                loop.call_at(next_moment(gather) if gather else 0.0, _finish, done)

        loop.add_reader(descriptor, take)
        try:
            async with asyncio.timeout(seconds):
                await done
        except TimeoutError:
            pass  # bytes received until then are returned
        finally:
            loop.remove_reader(descriptor)
        return came

    def _read(self, descriptor: int) -> bytes:
        try:
            data = os.read(descriptor, MOST_READ)
        except BlockingIOError:
            raise
        except OSError as error:
            raise self._gone(error.strerror) from error
        if not data:
            raise self._gone("end of file")
        return data

    def _gone(self, why: str | None) -> ConnectError:
        return ConnectError(f"{self._path}: the port is gone ({why}): is the adapter plugged in?")


def _finish(done: asyncio.Future[None]) -> None:
    if not done.done():
        done.set_result(None)


def listening_port(path: str, baud: int) -> AbstractAsyncContextManager[ListeningPort]:
    """Open a port exclusively and close it at the end. Raises ``ConnectError`` with the reason."""
    return opened_aside(lambda: ListeningPort(open_port(path, baud)), ListeningPort.close)


def _latency_timer(path: str) -> int | None:
    """The adapter's latency timer, ms; only the FTDI driver has one."""
    name = Path(path).resolve().name
    try:
        return int((ADAPTERS / name / "latency_timer").read_text())
    except (OSError, ValueError):
        return None
