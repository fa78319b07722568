"""An arm that sends what nobody asked for fills no log."""

from __future__ import annotations

import asyncio
import logging

import pytest

from cellwatt_drivers.shared.polling import NoAnswerError

from .rig import driver

UNASKED = bytes.fromhex("beef 0000 0005 01 04 02 0000") * 20


class Flood(asyncio.Protocol):
    """Answers each request with thousands of answers to others."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        for _ in range(200):
            asyncio.get_running_loop().call_soon(self.transport.write, UNASKED)


async def test_answers_that_nobody_asked_for_are_no_lines_of_the_log(caplog: pytest.LogCaptureFixture) -> None:
    logging.getLogger("pymodbus").setLevel(logging.NOTSET)
    server = await asyncio.get_running_loop().create_server(Flood, "127.0.0.1", 0)
    async with server:
        port = server.sockets[0].getsockname()[1]
        async with driver(f"127.0.0.1:{port}")._open() as modbus, modbus.turn(0.2):
            with pytest.raises(NoAnswerError), caplog.at_level(logging.INFO):
                await modbus.read("input", 0, 2, 1)
    assert not [record for record in caplog.records if record.name.startswith("pymodbus")]
