"""Each fault by itself: what the driver counts is what the emulator did, and it goes on."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from cellwatt.emulation import Fault
from cellwatt.emulation.relay import clients
from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver
from cellwatt_drivers.scpi_analyzer.emulator import ScpiAnalyzerEmulator
from tests.patience import eventually

from ..running import Run, strike
from .rig import emulated, running, settings

IGNORED = ("repeats", "merged ticks")


@asynccontextmanager
async def struck(
    fault: Fault, *, times: int, address: str = "127.0.0.1:0", **changes: object
) -> AsyncIterator[tuple[ScpiAnalyzerEmulator, Run[ScpiAnalyzerDriver]]]:
    """A driver and an emulator after a fault has struck ``times`` times and calm has returned."""
    changes = {"timeout": "300 ms", "rate": "50 Hz"} | changes
    async with emulated(address) as (emulator, place), running(settings(place, **changes)) as run:
        await eventually(lambda: len(run.inlet.readings) > 3)
        await strike(emulator, run.inlet, fault, times)
        yield emulator, run


def counters(run: Run[ScpiAnalyzerDriver]) -> dict[str, int]:
    """What was counted; a connection lost before it delivered is given up and run again: counted as a reconnect."""
    found = {k: n for k, n in run.inlet.account.counters.items() if k not in IGNORED}
    reconnects = found.pop("reconnects", 0) + len(run.failures)
    return found | ({"reconnects": reconnects} if reconnects else {})


@pytest.mark.parametrize("address", ["127.0.0.1:0", "pty"])
@pytest.mark.parametrize("kind", ["loss", "half_frame"])
async def test_an_answer_that_does_not_end_is_timed_out(kind, address):
    async with struck(Fault(kind, probability=0.2), times=5, address=address) as (emulator, run):
        n = emulator.counts[kind]
        assert counters(run) == {"timeouts": n, "reconnects": n}
        assert run.inlet.account.missed["timeout"] == n
        assert run.inlet.account.missed["disconnected"] > 0
        assert emulator.counts["made"] - emulator.counts["sent"] == n
        assert run.inlet.kinds() == ["reopened"] * (n - len(run.failures))


async def test_late_answers_never_shift():
    async with struck(Fault("delay", probability=0.2, seconds=0.4), times=5) as (emulator, run):
        n = emulator.counts["delay"]
        assert counters(run) == {"timeouts": n, "reconnects": n}
        # A shifted answer would be an identification or an error entry in place of values.
        assert run.inlet.account.missed["malformed"] == 0


async def test_garbage_is_counted_and_shifts_nothing():
    async with struck(Fault("garbage", probability=0.2), times=5) as (emulator, run):
        n = emulator.counts["garbage"]
        assert counters(run) == {"malformed": n, "reconnects": n}
        assert run.inlet.account.missed["malformed"] == n


async def test_an_outage_ends_the_run_and_the_next_one_counts_the_gap():
    async with struck(Fault("disconnect", seconds=0.3), times=1) as (_, run):
        assert "cannot be opened" in str(run.failures[0])
        assert run.inlet.account.missed["connection lost"] == 1
        assert run.inlet.account.missed["disconnected"] >= 10


async def _carriage_returns(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while line := await reader.readline():
        answers = {b"*IDN?\n": b"R&S,HMC8015,1,1.403", b"SYST:ERR?\n": b'0,"No error"', b"CHAN1:MEAS:FUNC?\n": b"P"}
        writer.write(answers.get(line, b"500.0") + b"\r")


async def _echoes(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while line := await reader.readline():
        writer.write(line + b"R&S,HMC8015,1,1.403\n")


async def test_lines_may_end_in_a_carriage_return_alone():
    async with clients(_carriage_returns) as (place, _), running(settings(place, functions=["P"])) as run:
        await run.inlet.until(lambda o: len(o.readings) > 2)
    assert run.inlet.values[:, 0].tolist() == [500.0] * len(run.inlet.readings)
    assert not run.failures


async def test_an_echo_is_told():
    async with clients(_echoes) as (place, _), running(settings(place)) as run:
        await run.inlet.until(lambda _: run.failures)
    assert f"{place} sends back what it receives: switch its echo off" in str(run.failures[0])
