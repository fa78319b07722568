from __future__ import annotations

import asyncio
import errno
import socket
import struct

import pytest

from cellwatt.emulation import Fault
from cellwatt.emulation.relay import clients
from cellwatt.errors import ConnectError
from cellwatt_drivers.modbus_meter import ModbusMeterDriver

from ..inlet import CollectingInlet
from ..running import strike
from .rig import emulated, running, settings

PLACES = ["127.0.0.1:0", "pty"]


@pytest.mark.parametrize("address", PLACES)
async def test_lost_answers_are_asked_for_again(address):
    async with emulated(address) as (emulator, place), running(settings(place, timeout="500 ms", retries=3)) as run:
        await run.inlet.until(lambda o: len(o.readings) >= 2)
        await strike(emulator, run.inlet, Fault("loss", probability=0.2), 4)
    assert run.inlet.account.counters["timeouts"] == emulator.counts["loss"]
    assert run.inlet.account.counters["retries"] + run.inlet.account.missed["timeout"] == emulator.counts["loss"]


@pytest.mark.parametrize("kind", ["half_frame", "garbage", "delay"])
@pytest.mark.parametrize("address", PLACES)
async def test_damaged_and_late_answers_never_become_values(address, kind):
    async with (
        emulated(address) as (emulator, place),
        running(settings(place, timeout="80 ms", silence="20 s")) as run,
    ):
        await run.inlet.until(lambda o: len(o.readings) >= 2)
        await strike(emulator, run.inlet, Fault(kind, probability=0.3, seconds=0.12), 4)
    column = run.driver.streams[0].names.index("supply.power")
    assert run.inlet.values[:, column] == pytest.approx([500.0] * len(run.inlet.values), rel=1e-6)
    assert run.inlet.values[:, 0] == pytest.approx([230.0] * len(run.inlet.values), rel=1e-6)
    found = (address, kind) == ("pty", "garbage")  # on RTU, the answer behind the garbage is found
    lost = run.inlet.account.counters["timeouts"] + run.inlet.account.counters["malformed"]
    assert lost == 0 if found else lost >= 1


async def test_a_silent_meter_is_given_up():
    async with emulated() as (emulator, place):
        async with running(settings(place, timeout="50 ms", silence="300 ms", retries=0)) as run:
            await run.inlet.until(lambda o: len(o.readings) >= 2)
            emulator.inject(Fault("loss"))
            await run.inlet.until(lambda _: run.failures)
        assert "unit 1 at TCP 127.0.0.1" in str(run.failures[0])
        assert "no answer" in str(run.failures[0])


async def test_connections_that_close_between_polls_lose_nothing():
    """As gateways do with a connection at rest; two meters share each connection."""
    opened = 0

    async def gateway(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal opened
        opened += 1
        for _ in range(4):
            writer.write(answer(await reader.readexactly(12)))
            await writer.drain()

    async with (
        clients(gateway) as (place, _),
        running(settings(place, **VOLTAGE)) as one,
        running(settings(place, unit=2, **VOLTAGE)) as two,
    ):
        for run in (one, two):
            await run.inlet.until(lambda o: len(o.readings) >= 12)
    for run in (one, two):
        assert not run.failures
        assert not run.inlet.account.missed
        assert {round(v, 2) for v in run.inlet.values[:, 0]} == {230.1}
    asked = sum(len(run.inlet.readings) + 2 for run in (one, two))
    assert opened <= asked / 4 + 2


@pytest.mark.parametrize("damaged", [b"\x65\x01\x02", b"\x04\x04\x43", b"\x00"])
async def test_an_invalid_frame_costs_one_poll_and_not_the_connection(damaged, caplog):
    opened = 0

    async def meter(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal opened
        opened += 1
        while request := await reader.readexactly(12):
            writer.write(answer(request, damaged if request[1] % 5 == 0 else None))

    async with clients(meter) as (place, _), running(settings(place, **VOLTAGE)) as run:
        await run.inlet.until(lambda o: o.account.missed["malformed"] >= 2 and len(o.readings) >= 4)
    assert (opened, run.failures, caplog.records) == (1, [], [])


async def test_a_meter_that_is_busy_is_asked_again():
    async def meter(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while request := await reader.readexactly(12):
            writer.write(answer(request, b"\x84\x06" if request[1] % 3 == 0 else None))

    async with clients(meter) as (place, _), running(settings(place, **VOLTAGE)) as run:
        await run.inlet.until(lambda o: o.account.counters["retries"] >= 3 and len(o.readings) >= 6)
    assert (run.failures, run.inlet.account.missed) == ([], {})


async def test_a_gateway_that_refuses_in_its_own_name_is_understood():
    async def gateway(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while request := await reader.readexactly(12):
            writer.write(answer(request, b"\x84\x0b", unit=255))

    async with clients(gateway) as (place, _), running(settings(place, **VOLTAGE)) as run:
        await run.inlet.until(lambda _: run.failures)
    assert "refuses registers 0 to 1: the gateway got no answer from it (exception 11)" in str(run.failures[0])


async def _as_another_unit(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while request := await reader.readexactly(12):
        writer.write(answer(request, unit=0))


async def _late(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    before = await reader.readexactly(12)
    while request := await reader.readexactly(12):
        writer.write(answer(before))
        before = request


@pytest.mark.parametrize(
    ("meter", "text"),
    [(_as_another_unit, "answers as unit 0: write unit: 0"), (_late, "answers too late: write a longer timeout")],
)
async def test_answers_that_do_not_count_are_told(meter, text):
    async with clients(meter) as (place, _), running(settings(place, timeout="50 ms", **VOLTAGE)) as run:
        await run.inlet.until(lambda _: run.failures)
    assert f"unit 1 at TCP {place} {text}" in str(run.failures[0])


NOISES = {"zero": b"\0%b", "turning": b"\xff\0%b\0\0\0", "foreign": b"\x01\x03\x02\0\0%b", "echo": b"%b"}
RTU = {0: bytes.fromhex("01 04 04 43 66 19 9A 85 E4"), 0x46: bytes.fromhex("01 04 04 42 48 00 00 6F EA")}


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("whole", [True, False])
async def test_rtu_answers_are_found_among_noise_and_echoes(noise, whole):
    async def meter(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while request := await reader.readexactly(8):
            sent = (request if noise == "echo" else b"") + NOISES[noise] % RTU[request[3]]
            for part in [sent] if whole else [sent[:6], sent[6:]]:
                writer.write(part)
                await asyncio.sleep(0.01)

    async with clients(meter) as (place, _), running(settings(place, framing="rtu", retries=0, **VOLTAGE)) as run:
        await run.inlet.until(lambda o: len(o.readings) >= 4)
    assert not run.failures
    assert {round(v, 2) for v in run.inlet.values[:, 0]} == {230.1}


async def test_bytes_that_are_no_answer_are_told():
    async def meter(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while request := await reader.readexactly(8):
            writer.write(request + b"\xe0\x1c")

    wrong = {"framing": "rtu", "timeout": "50 ms", "retries": 0}
    async with clients(meter) as (place, _), running(settings(place, **wrong, **VOLTAGE)) as run:
        await run.inlet.until(lambda _: run.failures)
    assert "sends no valid answer (e0 1c): check speed, parity and wires" in str(run.failures[0])


async def test_one_lost_answer_is_no_silence_at_a_slow_rate():
    async def meter(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while request := await reader.readexactly(12):
            if request[1] % 4:
                writer.write(answer(request))

    slow = {"rate": "10 Hz", "silence": "20 ms", "timeout": "10 ms", "retries": 0}
    async with clients(meter) as (place, _), running(settings(place, **slow, **VOLTAGE)) as run:
        await run.inlet.until(lambda o: o.account.missed["timeout"] >= 2 and len(o.readings) >= 4)
    assert not run.failures


async def test_a_pc_without_sockets_is_told_from_a_meter_that_is_off(monkeypatch):
    def none_left(*_: object, **__: object) -> None:
        raise OSError(errno.EMFILE, "too many")

    monkeypatch.setattr(socket, "socket", none_left)
    with pytest.raises(ConnectError, match="no socket can be opened: Too many open files"):
        await ModbusMeterDriver("m", settings("127.0.0.1:9"), CollectingInlet()).identify()


VOLTAGE = {"read": ["phase_1.voltage"], "mains_may_be_off": True}


def answer(request: bytes, pdu: bytes | None = None, unit: int | None = None) -> bytes:
    """A frame for a request: 230.1 V or 50 Hz, another unit's, or other bytes."""
    number, asked, address = struct.unpack_from(">H4xBxH", request)
    value = struct.pack(">BBf", 4, 4, 50.0 if address == 0x46 else 230.1)
    body = value if pdu is None else pdu
    return struct.pack(">HHHB", number, 0, 1 + len(body), asked if unit is None else unit) + body
