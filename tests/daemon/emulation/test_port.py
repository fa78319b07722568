"""A port answers, and does what its faults say."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager, suppress

import pytest

from cellwatt.emulation import Fault, TcpPort
from cellwatt.emulation.terminal import PtyPort
from tests.patience import eventually

from .device import Device


@asynccontextmanager
async def echoing(device: Device):
    """A port that answers each line with itself in capitals; its address."""

    async def talk(reader, writer):
        while line := await reader.readline():
            await port.asked()
            await port.answer(line.upper(), writer.write, lambda noise: b"#" * len(noise))

    port = TcpPort(device, talk)
    async with port as address:
        yield address


async def connect(address: str):
    host, port = address.split(":")
    return await asyncio.open_connection(host, int(port))


@pytest.mark.parametrize(
    ("kind", "come", "sent"), [("loss", b"", 0), ("half_frame", b"HELL", 0), ("garbage", b"#", 1), ("delay", b"H", 1)]
)
async def test_faults_strike_an_answer(kind, come, sent) -> None:
    device = Device()
    async with echoing(device) as address:
        reader, writer = await connect(address)
        device.inject(Fault(kind))
        writer.write(b"hello\n")
        writer.write_eof()
        came = await reader.read()
        writer.close()
    assert device.counts == {"made": 1, "sent": sent, kind: 1}
    assert came.startswith(come[:1])
    assert came.endswith(b"HELLO\n") == bool(sent)
    assert len(came) < len(b"HELLO\n") or sent


async def test_a_disconnect_hangs_up_and_refuses_until_it_is_over() -> None:
    device = Device()
    async with echoing(device) as address:
        idle, asking = await connect(address), await connect(address)
        device.inject(Fault("disconnect", seconds=0.3))
        asking[1].write(b"hello\n")
        assert await asking[0].read() == b""
        assert await idle[0].read() == b""
        with pytest.raises(OSError, match=r"refused|111"):
            await connect(address)
        reader, writer = await eventually(lambda: come_back(address), "the port")
        writer.write(b"again\n")
        assert await reader.readline() == b"AGAIN\n"
        for end in (idle[1], asking[1], writer):
            end.close()
    assert device.counts == {"made": 1, "sent": 1, "disconnect": 1}


async def come_back(address: str):
    with suppress(OSError):
        return await connect(address)


async def test_leaving_the_port_leaves_no_client_and_no_task() -> None:
    before = asyncio.all_tasks()
    async with echoing(Device()) as address:
        reader, writer = await connect(address)
    assert await reader.read() == b""
    writer.close()
    with pytest.raises(OSError, match=r"refused|111"):
        await connect(address)
    assert asyncio.all_tasks() == before


async def test_a_port_that_is_taken_is_told() -> None:
    async with echoing(Device()) as address:
        with pytest.raises(OSError, match=r"in use|98"):
            async with echoing(Device(address)):
                pass


async def test_a_line_without_an_end_does_not_end_a_pseudo_terminal() -> None:
    said = []

    async def talk(reader, _writer):
        while line := await reader.readline():
            said.append(line)

    reader = asyncio.StreamReader(limit=10)
    reader.feed_data(b"x" * 30 + b"\nhello\n")
    reader.feed_eof()
    await PtyPort(Device("pty"), talk)._converse(reader, None)
    assert said == [b"hello\n"]
