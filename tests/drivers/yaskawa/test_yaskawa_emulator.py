"""The emulator against bytes worked out by hand, without our own codec on the asking side."""

from __future__ import annotations

import asyncio
import socket

import pytest

from tests.patience import PATIENCE

from .rig import emulated

REQUEST = "594552432000{size:02x}00 03 01 00 {number:02x} 00000000 3939393939393939 {tail} {data}"


async def ask(port: int, tail: str, number: int = 7, data: str = "") -> bytes:
    loop = asyncio.get_running_loop()
    asked = bytes.fromhex(REQUEST.format(size=len(bytes.fromhex(data)), number=number, tail=tail, data=data))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.setblocking(False)
        client.connect(("127.0.0.1", port))
        await loop.sock_sendall(client, asked)
        return await asyncio.wait_for(loop.sock_recv(client, 512), PATIENCE)


async def test_status_is_the_worked_frame():
    async with emulated() as (emulator, port):
        answer = await ask(port, "7200 0100 00 01 0000")
        assert emulator.counts == {"made": 1, "sent": 1}
    assert answer == bytes.fromhex(
        "5945524320000800 03010107 00000080 3939393939393939 81000000 00000000 cc00000040000000"
    )


@pytest.mark.parametrize(
    ("tail", "added"),
    [
        ("9900 0100 00 01 0000", 0xA000),
        ("7500 0200 00 01 0000", 0xA001),
        ("7a00 0500 01 10 0000", 0x2100),
        ("0203 0300 00 34 0000", 0x2100),
        ("7a00 0500 01 55 0000", 0xA000),
    ],
    ids=["command", "instance", "write", "plural write", "service"],
)
async def test_what_it_refuses(tail, added):
    async with emulated() as (_, port):
        answer = await ask(port, tail)
    assert (answer[25], answer[26]) == (0x1F, 2), "an error, with an added status of two words"
    assert int.from_bytes(answer[28:30], "little") == added
    assert len(answer) == 32


async def test_what_is_no_request_gets_no_answer():
    async with emulated() as (emulator, port):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.setblocking(False)
            client.sendto(b"hello", ("127.0.0.1", port))
            client.sendto(
                bytes.fromhex(REQUEST.format(size=0, number=1, data="", tail="7200 0100 00 01 0000"))[:31],
                ("127.0.0.1", port),
            )
        await ask(port, "7200 0100 00 01 0000")
        assert emulator.counts == {"made": 1, "sent": 1, "malformed": 2}
