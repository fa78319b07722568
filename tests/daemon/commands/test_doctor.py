"""``cellwatt doctor`` on devices that answer, refuse, hang, break."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any
from unittest.mock import AsyncMock

import numpy as np
import pytest

from cellwatt import Reading, SourceError
from tests.daemon.commands.calling import CELL, Call, call, cell
from tests.daemon.runtime.fakes import DEVICES, STEP, STREAM, FakeDriver, Order, drop, fail, give

__all__ = ["call", "cell"]

QUICK = ("--seconds", "0.05", "--patience", "0.05")


def samples(step: int, current: float, latency: int = 0) -> Order:
    """50 samples, ``step`` ns apart, that came ``latency`` ns after they were asked for."""

    async def order(driver: FakeDriver) -> None:
        for n in range(50):
            driver.inlet.account.expect()
            at = 10**18 + n * step
            driver.inlet.emit(Reading(STREAM, np.array([[float(n), current]]), at, asked=at - latency))

    return order


def look(call: Call, cell: Path) -> tuple[int, dict[str, Any]]:
    ended = call("doctor", cell, *QUICK, "--json")
    return ended.code, json.loads(ended.out)["arm"]


def test_a_device_as_declared(call: Call, cell: Path) -> None:
    DEVICES["arm"].tell(give(50))
    code, found = look(call, cell)
    assert (code, found["verdict"], found["findings"]) == (0, "ok", [])
    assert found["status"]["identity"]["model"] == "Model"
    assert found["status"]["streams"]["supply"]["rate_hz"] == pytest.approx(50.0)
    voltage, current = found["channels"]
    assert (voltage["low"], voltage["high"], voltage["unit"]) == (0.0, 49.0, "V")
    assert (current["low"], current["high"], current["finite"]) == (1.0, 1.0, 1.0)
    assert DEVICES["arm"].open == 0


BREAKS = AsyncMock(side_effect=KeyError("serial"))


@pytest.mark.parametrize(
    ("who", "finding"),
    [
        (AsyncMock(side_effect=SourceError("no free connection")), "no free connection"),
        (lambda: asyncio.Event().wait(), "no answer within 0.05 s"),
        (BREAKS, "the fake driver failed: KeyError: 'serial'"),
    ],
)
def test_a_device_that_does_not_say_who_it_is(call: Call, cell: Path, who: Any, finding: str) -> None:
    DEVICES["arm"].who = who
    code, found = look(call, cell)
    assert (code, found["verdict"], found["findings"]) == (1, "failed", [finding])
    assert not DEVICES["arm"].runs


def test_one_that_breaks_leaves_the_others(call: Call, cell: Path) -> None:
    cell.write_text(CELL + "  board: {driver: fake, host: board}\n")
    DEVICES["arm"].who = BREAKS
    DEVICES["board"].tell(give(50))
    ended = call("doctor", cell, *QUICK, "--json")
    assert {n: e["verdict"] for n, e in json.loads(ended.out).items()} == {"arm": "failed", "board": "ok"}


def test_another_rate_and_losses_are_warnings(call: Call, cell: Path) -> None:
    DEVICES["arm"].tell(samples(2 * STEP, np.nan), drop(3, "checksum"))
    code, found = look(call, cell)
    assert (code, found["verdict"]) == (0, "warning")
    assert found["findings"] == [
        "supply: declared 50 Hz, measured 25.0 Hz",
        "3 of 53 samples lost: 3 checksum",
        "no values: bus.current",
    ]


def test_in_words(call: Call, cell: Path) -> None:
    DEVICES["arm"].tell(give(50), fail(SourceError("connection reset")))
    ended = call("doctor", cell, *QUICK)
    assert ended.code == 1
    lines = ended.out.splitlines()
    assert "arm: reading stopped: connection reset" in lines
    assert "  arm: bus.voltage: 0 … 49 V" in lines
    assert "  arm: constant: bus.current 1 A" in lines


def test_what_the_device_said_meanwhile_is_told(call: Call, cell: Path) -> None:
    async def says(driver: FakeDriver) -> None:
        for kind, text in (
            ("program_state", "program: stopped → running"),
            ("value_refused", "arm: bus.power is left out: \x1b[2Jit has no such register"),
            ("value_refused", "arm: bus.energy is left out"),
        ):
            driver.inlet.event(kind, text)

    DEVICES["arm"].tell(give(50), says)
    code, found = look(call, cell)
    assert (code, found["verdict"]) == (0, "warning")
    assert found["findings"] == [
        "program: stopped → running",
        "bus.power is left out:  [2Jit has no such register (and 1 more of value_refused)",
    ]


def test_stamps_that_may_be_off_by_seconds(call: Call, cell: Path) -> None:
    DEVICES["arm"].tell(samples(STEP, 1.0, 8_000_000_000))
    code, found = look(call, cell)
    assert (code, found["verdict"]) == (0, "warning")
    assert "supply: its time stamps may be wrong by 4 s" in found["findings"][0]
