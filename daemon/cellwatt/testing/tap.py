"""Captures the bytes that a driver sends, with a relay between it and the emulator."""

from __future__ import annotations

import asyncio
import os
import pty
import tty
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

from cellwatt.testing.rig import Transport

_MOST = 65536


@asynccontextmanager
async def tapped(address: str, transport: Transport) -> AsyncIterator[tuple[str, list[bytearray]]]:
    """A relay to ``address``: its own address, and the bytes that the driver sent.

    There is one entry per TCP connection or UDP datagram, or a single one for a serial port.
    """
    sent: list[bytearray] = []
    relay = {"tcp": _tcp, "udp": _udp, "pty": _pty}[transport]
    async with relay(address, sent) as place:
        yield place, sent


@asynccontextmanager
async def _tcp(address: str, sent: list[bytearray]) -> AsyncIterator[str]:
    host, _, port = address.rpartition(":")
    talking: set[asyncio.Task[None]] = set()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        talking.add(task)
        kept = bytearray()
        sent.append(kept)
        try:
            up, down = await asyncio.open_connection(host, int(port))
            try:
                await _both(_pump(reader, down, kept.extend), _pump(up, writer, lambda _: None))
            finally:
                down.close()
        except (OSError, asyncio.CancelledError):
            pass  # one end is gone, or the test is over: nobody awaits this task
        finally:
            talking.discard(task)
            writer.close()

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    try:
        yield f"127.0.0.1:{server.sockets[0].getsockname()[1]}"
    finally:
        server.close()
        for task in talking:
            task.cancel()
        await asyncio.gather(*talking, return_exceptions=True)
        await asyncio.sleep(0)


async def _both(*pumps: object) -> None:
    """Relay in both directions until one end closes."""
    tasks = [asyncio.ensure_future(p) for p in pumps]  # type: ignore[call-overload]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, see: Callable[[bytes], None]) -> None:
    while data := await reader.read(_MOST):
        see(data)
        writer.write(data)
        await writer.drain()


class _Relay(asyncio.DatagramProtocol):
    def __init__(self, see: Callable[[bytes, tuple[str, int]], None]) -> None:
        self._see = see

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self._see(data, addr)


@asynccontextmanager
async def _udp(address: str, sent: list[bytearray]) -> AsyncIterator[str]:
    host, _, port = address.rpartition(":")
    loop = asyncio.get_running_loop()
    links: dict[tuple[str, int], asyncio.DatagramTransport] = {}
    waiting: set[asyncio.Task[None]] = set()

    async def forward(data: bytes, client: tuple[str, int]) -> None:
        if client not in links:
            links[client], _ = await loop.create_datagram_endpoint(
                lambda: _Relay(lambda answer, _: front.sendto(answer, client)), remote_addr=(host, int(port))
            )
        links[client].sendto(data)

    def see(data: bytes, client: tuple[str, int]) -> None:
        sent.append(bytearray(data))
        task = asyncio.create_task(forward(data, client))
        waiting.add(task)
        task.add_done_callback(waiting.discard)

    front, _ = await loop.create_datagram_endpoint(lambda: _Relay(see), local_addr=("127.0.0.1", 0))
    try:
        yield "127.0.0.1:{}".format(front.get_extra_info("sockname")[1])
    finally:
        for transport in [front, *links.values()]:
            transport.close()
        await asyncio.sleep(0)


@asynccontextmanager
async def _pty(address: str, sent: list[bytearray]) -> AsyncIterator[str]:
    loop = asyncio.get_running_loop()
    kept = bytearray()
    sent.append(kept)
    master, slave = pty.openpty()
    tty.setraw(slave)
    device = os.open(address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def move(source: int, target: int, see: Callable[[bytes], None]) -> None:
        with suppress(OSError):  # one end is gone; the driver sees it by itself
            data = os.read(source, _MOST)
            see(data)
            os.write(target, data)

    loop.add_reader(master, move, master, device, kept.extend)
    loop.add_reader(device, move, device, master, lambda _: None)
    try:
        yield os.ttyname(slave)
    finally:
        for fd in (master, device):
            loop.remove_reader(fd)
        for fd in (master, device, slave):
            os.close(fd)
