"""The emulated controller, spoken to with plain sockets and worked bytes."""

from __future__ import annotations

import asyncio
import socket
import struct
from contextlib import asynccontextmanager

import numpy as np
import pytest

from cellwatt.emulation import ArmSignals, RecordedSignals
from cellwatt.ticker import Ticker
from cellwatt_drivers.ur.emulated_samples import Rows
from cellwatt_drivers.ur.emulator import UrEmulator
from tests.patience import PATIENCE, eventually

from ..running import served

ASK_VERSION = bytes.fromhex("0005560002")
OUTPUTS = bytes.fromhex("00284f407f40000000000074696d657374616d702c61637475616c5f712c726f626f745f6d6f6465")


class Peer:
    """A client that reads frame by frame."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    async def ask(self, question: bytes) -> bytes:
        self._writer.write(question)
        return await self.frame()

    async def frame(self) -> bytes:
        async with asyncio.timeout(PATIENCE):
            head = await self._reader.readexactly(2)
            return head + await self._reader.readexactly(int.from_bytes(head, "big") - 2)

    async def packages(self, n: int) -> list[tuple[float, ...]]:
        return [struct.unpack(">4x7di", await self.frame()) for _ in range(n)]

    async def at_end(self) -> bool:
        async with asyncio.timeout(PATIENCE):
            return await self._reader.read(1) == b""

    async def start(self, outputs: bytes = OUTPUTS) -> None:
        assert await self.ask(ASK_VERSION) == bytes.fromhex("00045601")
        assert (await self.ask(outputs))[:4].hex() == "00194f01"
        assert await self.ask(bytes.fromhex("000353")) == bytes.fromhex("00045301")

    async def close(self) -> None:
        self._writer.close()
        await self._writer.wait_closed()


@asynccontextmanager
async def serving(signals=None, **options: str):
    emulator = UrEmulator(signals or ArmSignals(), "127.0.0.1:0", options=options)
    peers: list[Peer] = []

    async def connect(buffer: int | None = None) -> Peer:
        host, _, port = address.rpartition(":")
        peer = socket.socket()
        peer.setblocking(False)
        if buffer is not None:
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        await asyncio.get_running_loop().sock_connect(peer, (host, int(port)))
        peers.append(Peer(*await asyncio.open_connection(sock=peer)))
        return peers[-1]

    async with served(emulator) as address:
        try:
            yield emulator, connect
        finally:
            for peer in peers:
                await peer.close()
    await asyncio.sleep(0)


def recording(n: int = 40, step: float = 0.004, loop: bool = False) -> RecordedSignals:
    time = 1000.0 + step * np.arange(n)
    columns = {f"actual_q_{i}": np.sin(time + i) for i in range(6)}
    return RecordedSignals(time, columns, loop)


@pytest.mark.parametrize(("polyscope", "rate", "step"), [("5.12.0", 500, 2), ("5.12.0", 100, 10), ("3.15.0", 125, 8)])
async def test_packages_keep_the_grid_of_the_controller(polyscope, rate, step):
    async with serving(polyscope=polyscope) as (emulator, connect):
        peer = await connect()
        await peer.start(OUTPUTS[:3] + struct.pack(">d", rate) + OUTPUTS[11:])
        rows = await peer.packages(60)
        steps = np.diff([r[0] for r in rows])
        np.testing.assert_allclose(steps, step / 1000, atol=1e-9)
        assert all(r[-1] == 7 for r in rows)
        await eventually(lambda: emulator.counts["made"] == emulator.counts["sent"] >= 60)


async def test_rows_of_a_recording_go_out_at_their_own_times(monkeypatch):
    moments, until = [], Ticker.until
    monkeypatch.setattr(Ticker, "until", lambda ticker, moment: moments.append(moment) or until(ticker, moment))
    signals = recording()
    async with serving(signals) as (emulator, connect):
        peer = await connect()
        await peer.start()
        await peer.packages(40)
    own = {round((emulator._began + (t - signals.time[0])) * 1e9) for t in signals.time}
    assert len(own.intersection(moments)) > 5  # of 40: a busy machine may be late for others


def test_each_row_falls_due_at_its_time_in_each_lap_and_none_after_the_last():
    times, columns = np.array([7.0, 7.1, 7.3]), {"robot_mode": np.full(3, 7.0)}
    once, looped = (Rows(RecordedSignals(times, columns, loop), hold=False) for loop in (False, True))
    assert [once.next(t) for t in (-1.0, 0.0, 0.15, 0.3)] == pytest.approx([0.0, 0.1, 0.3, np.inf])
    assert [looped.next(t) for t in (0.15, 0.31, 0.46)] == pytest.approx([0.3, 0.45, 0.55])


async def test_a_disturbance_of_the_world_and_messages():
    async with serving(ArmSignals(noise=0.0)) as (emulator, connect):
        peer = await connect()
        await peer.start()
        emulator.disturb({"encoder": 1, "offset": 10.0})
        emulator.disturb({"message": "hello"})
        found = [await peer.frame() for _ in range(300)]
        texts = [f for f in found if f[2:3] == b"M"]
        assert texts == [b"\x00\x13M\x05hello\x08emulator\x02"]
        assert struct.unpack_from(">d", found[-1], 12)[0] > 5.0
        with pytest.raises(ValueError, match="spring"):
            emulator.disturb({"nonsense": 1})


async def test_a_client_that_is_no_rtde_client_is_thrown_out():
    async with serving() as (_, connect):
        peer = await connect()
        peer._writer.write(b"GET / HTTP/1.1\r\n\r\n")
        assert await peer.at_end()


async def test_a_controller_that_reboots_before_its_first_client_refuses_clients():
    emulator = UrEmulator(ArmSignals(), "127.0.0.1:0")
    emulator.disturb({"reboot": 3600.0})  # as by the command line, before the emulator serves
    async with served(emulator) as address:
        await eventually(lambda: emulator._port._outage is not None, "its outage")
        await asyncio.sleep(0)
        host, _, port = address.rpartition(":")
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(host, int(port))


@pytest.mark.blocks_loop  # 100,000 packages a second fill what lies between in no time
async def test_a_client_that_does_not_read_is_thrown_out():
    async with serving(recording(n=2000, step=0.00001, loop=True)) as (emulator, connect):
        peer = await connect(buffer=4096)  # or megabytes fill on the way first
        peer._writer.transport.pause_reading()
        for question in (ASK_VERSION, OUTPUTS[:3] + struct.pack(">d", 1.0) + OUTPUTS[11:], bytes.fromhex("000353")):
            peer._writer.write(question)
        await eventually(lambda: emulator.counts.get("unread"), "its end")


@pytest.mark.parametrize(
    ("address", "options", "message"),
    [
        ("127.0.0.1", {}, "HOST:PORT"),
        ("", {"polyscope": "new"}, "like 5.12.0"),
        ("", {"at_end": "stop"}, "at_end"),
    ],
)
def test_wrong_options_are_named(address, options, message):
    with pytest.raises(ValueError, match=message):
        UrEmulator(ArmSignals(), address, options=options)
