"""Answers with another transaction number than the request's, as faulty gateways give them."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest
from pymodbus.simulator import DataType, SimData

from cellwatt.emulation.relay import clients
from cellwatt.errors import ConnectError
from cellwatt_drivers.modbus_meter import ModbusMeterDriver
from cellwatt_drivers.shared.modbus import Numbering
from cellwatt_drivers.shared.polling import NoAnswerError

from ..inlet import CollectingInlet
from .rig import answering, running, settings

MAP = """maker: Acme
model: A1
function: holding
type: uint16
values:
  supply.voltage: {address: 0, unit: V, between: [10, 1000]}
  supply.frequency: {address: 1, unit: Hz, between: [40, 70]}
"""


@asynccontextmanager
async def numbering(number: Callable[[int], int]) -> AsyncIterator[str]:
    """A meter that answers request ``n`` (from 1) with the transaction number ``number(n)``."""
    answered = 0

    def trace(sending: bool, data: bytes) -> bytes:
        nonlocal answered
        if not sending:
            return data
        answered += 1
        return struct.pack(">H", number(answered)) + data[2:]

    async with answering(SimData(0, values=[230, 50], datatype=DataType.REGISTERS), trace_packet=trace) as place:
        yield place


async def test_answers_with_another_number_are_told_and_counted_apart(tmp_path):
    (tmp_path / "map.yaml").write_text(MAP)
    changes = {"map": str(tmp_path / "map.yaml"), "timeout": "50 ms", "retries": 0}
    async with (
        numbering(lambda n: 60_000 + n if n % 4 == 0 else n) as place,
        running(settings(place, **changes)) as run,
    ):
        await run.inlet.until(lambda o: o.account.received >= 8)
    account = run.inlet.account
    assert account.missed["other transaction number"] == account.counters["other transaction numbers"] >= 2
    assert "timeouts" not in account.counters
    assert "other transaction numbers" in account.anomalies
    assert "device_error" in run.inlet.kinds()
    assert not run.failures


@pytest.mark.parametrize("number", [lambda n: n + 7, lambda n: 65_535])
async def test_a_gateway_with_numbers_of_its_own_is_told_on_connecting(tmp_path, number):
    (tmp_path / "map.yaml").write_text(MAP)
    async with numbering(number) as place:
        made = settings(place, map=str(tmp_path / "map.yaml"), timeout="50 ms", retries=0)
        with pytest.raises(ConnectError, match=r"another transaction number \(\d+, asked with 1\): is the gateway"):
            await ModbusMeterDriver("m", made, CollectingInlet()).identify()


def frame(number: int) -> bytes:
    return struct.pack(">HHHBBBHH", number, 0, 7, 1, 3, 4, 230, 50)


def test_a_late_answer_is_no_strange_one():
    def told() -> str:
        return str(numbers.of(NoAnswerError("unit 1 gave no answer")))

    numbers = Numbering()
    numbers.trace(True, frame(1))
    numbers.trace(True, frame(2))
    assert numbers.trace(False, frame(1) + frame(2)[:5]) == frame(1) + frame(2)[:5]
    assert told() == "unit 1 answers too late: write a longer timeout"
    numbers.trace(False, frame(1))
    assert told().startswith("unit 1 answers with another transaction number (1, asked with 2)"), "answered already"
    numbers.trace(True, frame(3))
    assert told() == "unit 1 gave no answer"


async def test_answers_in_pieces_and_late_ones_before_them_are_read(tmp_path):
    """As converters and proxies send them: byte by byte, and in one segment with the answer to a request given up."""
    (tmp_path / "map.yaml").write_text(MAP)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        late = b""
        while request := await reader.readexactly(12):
            number, _, _, unit, function, _, count = struct.unpack(">HHHBBHH", request)
            words = struct.pack(">2H", 230, 50)[: 2 * count]
            answer = struct.pack(">HHHBBB", number, 0, 3 + len(words), unit, function, len(words)) + words
            if number % 8 == 0:
                late = answer
                continue
            if late:
                writer.write(late + answer)
                late = b""
                continue
            for byte in answer:
                writer.write(bytes([byte]))
                await writer.drain()
                await asyncio.sleep(0)

    changes = {"map": str(tmp_path / "map.yaml"), "timeout": "100 ms", "retries": 0}
    async with clients(serve) as (place, _), running(settings(place, **changes)) as run:
        await run.inlet.until(lambda o: o.account.received >= 12 and o.account.counters["timeouts"])
    assert {tuple(row) for row in run.inlet.values.tolist()} == {(230.0, 50.0)}
    assert not run.failures
