"""Captures the bytes that a driver sends, with a relay between it and the emulator."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

from cellwatt.emulation.relay import MOST, clients, pass_on
from cellwatt.emulation.terminal import raw_terminal
from cellwatt.testing.rig import Transport


@asynccontextmanager
async def tapped(address: str, transport: Transport) -> AsyncIterator[tuple[str, list[bytearray]]]:
    """A relay to ``address``: yields its own address, and the bytes that the driver sent.

    There is one entry per TCP connection or UDP datagram, or a single one for a serial port.
    """
    sent: list[bytearray] = []
    relay = {"tcp": _tcp, "udp": _udp, "pty": _pty}[transport]
    async with relay(address, sent) as place:
        yield place, sent


@asynccontextmanager
async def _tcp(address: str, sent: list[bytearray]) -> AsyncIterator[str]:
    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        kept = bytearray()
        sent.append(kept)

        async def see(data: bytes) -> None:
            kept.extend(data)

        await pass_on(reader, writer, address, see)

    async with clients(talk) as (place, _):
        yield place


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
    device = os.open(address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def move(source: int, target: int, see: Callable[[bytes], None]) -> None:
        with suppress(OSError):  # one end is closed; the driver detects it
            data = os.read(source, MOST)
            see(data)
            os.write(target, data)

    with raw_terminal() as (near, place):
        loop.add_reader(near, move, near, device, kept.extend)
        loop.add_reader(device, move, device, near, lambda _: None)
        try:
            yield place
        finally:
            loop.remove_reader(near)
            loop.remove_reader(device)
            os.close(device)
