from __future__ import annotations

import asyncio
import errno
import socket
import struct
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from itertools import count

import pytest

from cellwatt.emulation import Fault
from cellwatt.emulation.relay import clients
from cellwatt.errors import ConnectError
from cellwatt_drivers.modbus_meter import ModbusMeterDriver
from cellwatt_drivers.shared.modbus import Checksums, Numbering, TcpPlace, line
from cellwatt_drivers.shared.polling import NoAnswerError

from ..inlet import CollectingInlet
from ..running import Run, endpoint, strike
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


VOLTAGE = {"read": ["phase_1.voltage"], "mains_may_be_off": True}


def answer(request: bytes, pdu: bytes | None = None, unit: int | None = None, other: int | None = None) -> bytes:
    """A frame for a request: 230.1 V or 50 Hz, another unit's, with another number, or other bytes."""
    number, asked, address = struct.unpack_from(">H4xBxH", request)
    number = number if other is None else other
    value = struct.pack(">BBf", 4, 4, 50.0 if address == 0x46 else 230.1)
    body = value if pdu is None else pdu
    return struct.pack(">HHHB", number, 0, 1 + len(body), asked if unit is None else unit) + body


@asynccontextmanager
async def asking(
    reply: Callable[[bytes], bytes],
    ends: Callable[[bytes], bool] = lambda request: False,
    size: int = 12,
    **more: object,
) -> AsyncIterator[tuple[Run[ModbusMeterDriver], list[int]]]:
    """A driver that reads a voltage and the number of its connections; ``ends``: after this request one ends."""
    opened = [0]

    async def meter(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        opened[0] += 1
        while request := await reader.readexactly(size):
            for byte in reply(request):
                writer.write(bytes([byte]))
                await asyncio.sleep(0)
            if ends(request):
                return

    async with clients(meter) as (place, _), running(settings(place, **VOLTAGE | more)) as run:
        yield run, opened
    for reading in run.inlet.readings:
        assert reading.values[0, 0] == pytest.approx(230.1)
        assert reading.arrival - reading.asked < run.driver.settings.timeout * 1e9


@pytest.mark.parametrize("amid", [False, True])
async def test_connections_that_close_between_polls_or_amid_an_answer_lose_nothing(amid):
    def some(request: bytes) -> bytes:
        return answer(request)[: 5 if amid and not request[1] % 4 else None]

    async with asking(some, lambda request: not request[1] % 4, timeout="5 s") as (run, opened):
        await run.inlet.until(lambda o: len(o.readings) >= 12)
    assert (run.failures, run.inlet.account.missed, run.inlet.account.counters["retries"]) == ([], {}, 0)
    assert opened[0] <= (len(run.inlet.readings) + 2) / (3 if amid else 4) + 2


@pytest.mark.parametrize("code", [2, 4])
async def test_a_refusal_leaves_a_value_out_at_the_start_alone_and_until_the_next_start(code):
    refused, asked = {0x46}, Counter[int]()

    def some(request: bytes) -> bytes:
        address = int.from_bytes(request[8:10], "big")
        asked[address] += 1
        return answer(request, bytes([0x84, code]) if address in refused or asked[address] == 4 else None)

    async with asking(some, read=["phase_1.voltage", "supply.frequency"]) as (run, _):
        await run.inlet.until(lambda o: len(o.readings) >= 6)
        assert run.driver.left_out == {"supply.frequency"}
        refused.clear()
        await run.driver.identify()
        assert not run.driver.left_out
        await run.inlet.until(lambda o: o.readings[-1].values[0, 1] == 50.0)
    assert not run.failures and run.inlet.account.missed["device error"] >= 1


async def test_the_stamps_are_those_of_the_request_that_was_answered():
    unanswered: list[int] = []

    def some(request: bytes) -> bytes:
        if request[1] % 3:
            return answer(request)
        unanswered.append(time.time_ns())
        return b""

    async with asking(some, timeout="200 ms") as (run, _):
        await run.inlet.until(lambda o: o.account.counters["retries"] >= 3 and len(o.readings) >= 6)
    assert not [r for r in run.inlet.readings if any(r.asked <= lost <= r.arrival for lost in unanswered)]


SLOW = {"rate": "4 Hz", "silence": "100 ms", "timeout": "200 ms", "retries": 0}


@pytest.mark.parametrize(
    ("wrong", "more", "missed"),
    [
        (lambda r: answer(r, b"\x65\x01\x02"), {}, "malformed"),
        (lambda r: answer(r, b"\x04\x04\x43"), {}, "malformed"),
        (lambda r: answer(r, b"\x04\x02\x43\x66"), {}, "malformed"),
        (lambda r: answer(r, b"\x00"), {}, "malformed"),
        (lambda r: answer(r, b"\x84\x06"), {}, None),  # it is busy
        (lambda r: b"", SLOW, "timeout"),  # one lost answer is no silence at a slow rate
    ],
)
async def test_a_wrong_answer_costs_one_poll_at_most_and_no_connection(wrong, more, missed, caplog):
    async with asking(lambda r: answer(r) if r[1] % 5 else wrong(r), **more) as (run, opened):
        what = run.inlet.account.missed if missed else run.inlet.account.counters
        await run.inlet.until(lambda o: what[missed or "retries"] >= 2 and len(o.readings) >= 4)
    assert (opened, run.failures, caplog.records) == ([1], [], [])
    assert set(run.inlet.account.missed) == {missed} - {None}


def _late() -> Callable[[bytes], bytes]:
    answers = deque([b""])

    def reply(request: bytes) -> bytes:
        answers.append(answer(request))
        return answers.popleft()

    return reply


RTU = {"framing": "rtu", "size": 8}


@pytest.mark.parametrize(
    ("reply", "more", "text"),
    [
        (lambda r: answer(r, b"\x84\x0b", unit=255), {}, "refuses registers 0 to 1: the gateway got no answer from it"),
        (lambda r: answer(r, unit=0), {}, "answers as unit 0: write unit: 0"),
        (_late(), {}, "answers too late: write a longer timeout"),
        (
            lambda r: answer(r, other=65_535),
            {},
            "answers with another transaction number (65535, asked with 2): is the",
        ),
        (lambda r: answer(r)[:-1], {}, "asked for registers 0 to 1, sends an answer that is not complete (00 02 00 00"),
        (lambda r: answer(r, b"\x84\x04"), {}, "refuses registers 0 to 1: it failed (exception 4)"),
        (lambda r: r, RTU, "asked for registers 0 to 1, gave no answer"),
        (lambda r: r + b"\xe0\x1c", RTU, "sends no valid answer (e0 1c): check speed, parity and wires"),
    ],
)
async def test_answers_that_do_not_count_are_told(reply, more, text):
    async with asking(reply, **{"timeout": "250 ms", **more}) as (run, _):
        await run.inlet.until(lambda _: run.failures)
    assert str(run.failures[0]).startswith(f"unit 1 at TCP 127.0.0.1:{run.driver.settings.port}")
    assert text in str(run.failures[0])


async def test_answers_with_another_number_are_told_and_counted_apart():
    async with asking(lambda r: answer(r, other=None if r[1] % 4 else 60_000), timeout="250 ms", retries=0) as (run, _):
        await run.inlet.until(lambda o: o.account.received >= 8)
    account = run.inlet.account
    assert account.missed["other transaction number"] == account.counters["other transaction numbers"] >= 2
    assert "timeouts" not in account.counters
    assert "other transaction numbers" in account.anomalies
    assert "device_error" in run.inlet.kinds()
    assert not run.failures


async def test_late_answers_before_the_answer_are_passed_over():
    late = []

    def reply(request: bytes) -> bytes:
        late.append(answer(request, struct.pack(">BBf", 4, 4, 7.0) if request[1] % 4 == 0 else None))
        return b"" if request[1] % 4 == 0 else b"".join(late[-2:])

    async with asking(reply, timeout="200 ms", retries=0) as (run, _):
        await run.inlet.until(lambda o: o.account.missed["timeout"] >= 2 and len(o.readings) >= 6)
    assert not run.failures


def test_a_late_answer_is_no_strange_one():
    def told() -> str:
        return str(numbers.of(NoAnswerError("unit 1 gave no answer")))

    first, second, third = (struct.pack(">HHHBBHH", number, 0, 6, 1, 4, 0, 2) for number in (1, 2, 3))
    numbers = Numbering()
    numbers.trace(True, first)
    numbers.trace(True, second)
    assert numbers.trace(False, answer(first) + answer(second)[:5]) == answer(first) + answer(second)[:5]
    assert told() == "unit 1 answers too late: write a longer timeout"
    numbers.trace(False, answer(first))
    assert told().startswith("unit 1 answers with another transaction number (1, asked with 2)"), "answered already"
    numbers.trace(True, third)
    assert told() == "unit 1 gave no answer"


ANSWERS = {0: bytes.fromhex("01 04 04 43 66 19 9A 85 E4"), 0x46: bytes.fromhex("01 04 04 42 48 00 00 6F EA")}


async def test_an_rtu_exchange_byte_by_byte():
    """The worked exchange of an SDM630: U1 = 230.10 V; through a serial device server with an echo."""
    heard = []

    def reply(request: bytes) -> bytes:
        heard.append(request)
        return request + b"\xff" + ANSWERS[request[3]] + b"\0"

    async with asking(reply, retries=0, **RTU) as (run, _):
        await run.inlet.until(lambda o: len(o.readings) >= 4)
    assert (heard[0], run.failures) == (SHORT[0], [])


SHORT = bytes.fromhex("01 04 00 00 00 02 71 CB"), ANSWERS[0]
LONG = bytes.fromhex("01 04 08 00 00 04 F3 A9"), bytes.fromhex("01 04 08 01 84 02 C2 C1 00 00 00 64 06")


@pytest.mark.parametrize("noise", [b"\0%b", b"\xff\0%b\0\0\0", b"\x01\x03\x02\0\0%b", b"%b", b"<echo>%b"])
@pytest.mark.parametrize(
    ("request_", "found"),
    [SHORT, LONG, (LONG[0], bytes.fromhex("01 84 02 C2 C1"))],
    ids=["short", "with an exception in it", "an exception"],
)
def test_rtu_answers_are_found_among_noise_and_echoes_and_in_pieces(noise, request_, found):
    numbering = Checksums()
    numbering.trace(True, request_)
    sent = noise.replace(b"<echo>", request_) % found
    got = [numbering.trace(False, sent[:size]) for size in range(1, len(sent) + 1)]
    due = sent.index(found, len(request_) * noise.startswith(b"<")) + len(found)
    assert got == [b""] * (due - 1) + [found] * (len(sent) - due + 1)


async def test_what_a_device_server_sends_before_the_first_request_is_noise(caplog):
    """Bytes from the line that it kept while nobody was connected."""

    async def device_server(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"\xff\0")
        while await reader.readexactly(8):
            writer.write(ANSWERS[0])

    async with clients(device_server) as (place, _):
        for _ in range(5):
            async with line(TcpPlace(**endpoint(place), framing="rtu", advice="")) as bus, bus.turn(5.0):
                assert await bus.read("input", 0, 2, 1) == [0x4366, 0x199A]
    assert Checksums().trace(False, b"\xff\0") == b""
    assert not caplog.records


async def test_an_answer_that_outlives_its_connection_is_no_answer_to_the_next_request():
    """A device server passes on what comes from the line to whoever is connected then."""
    requests, connected, passed = count(), list[asyncio.StreamWriter](), asyncio.Event()

    def pass_on() -> None:
        for writer in connected:
            writer.write(ANSWERS[0])
        passed.set()

    async def device_server(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connected.append(writer)
        while await reader.readexactly(8):
            if not next(requests):
                connected.remove(writer)
                asyncio.get_running_loop().call_later(0.02, pass_on)
                return
            await passed.wait()
            writer.write(ANSWERS[0x46])

    async with (
        clients(device_server) as (place, _),
        line(TcpPlace(**endpoint(place), framing="rtu", advice="")) as bus,
        bus.turn(0.2),
    ):
        await bus._open()
        assert await bus.read("input", 0x46, 2, 1) == [0x4248, 0]


async def test_a_pc_without_sockets_is_told_from_a_meter_that_is_off(monkeypatch):
    def none_left(*_: object, **__: object) -> None:
        raise OSError(errno.EMFILE, "too many")

    monkeypatch.setattr(socket, "socket", none_left)
    with pytest.raises(ConnectError, match="no socket can be opened: Too many open files"):
        await ModbusMeterDriver("m", settings("127.0.0.1:9"), CollectingInlet()).identify()
