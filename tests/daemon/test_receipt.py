"""What the kernel says of a datagram's receipt, held against clocks read around it."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Iterator

import pytest

from cellwatt import receipt
from cellwatt.receipt import receive, stamp_receipts

WAIT = 20_000_000  # ns


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
    ):
        here.bind(("127.0.0.1", 0))
        device.connect(here.getsockname())
        yield device, here


def leave_waiting(device: socket.socket, here: socket.socket) -> tuple[int, int]:
    """A datagram lies in ``here`` for at least so many ns, and at most so many once it is received at once."""
    before = time.monotonic_ns()
    device.send(b"sample")
    select.select([here], [], [], 10)
    there = time.monotonic_ns()
    while time.monotonic_ns() - there < WAIT:
        pass
    return time.monotonic_ns() - there, before


def test_the_time_a_datagram_waited_for_a_late_process_is_told(pair: tuple[socket.socket, socket.socket]) -> None:
    device, here = pair
    assert stamp_receipts(here)
    for _ in range(100):  # the kernel begins to stamp what arrives a little after it was asked to
        least, before = leave_waiting(device, here)
        datagram, sender, waited = receive(here, 2048)
        assert (datagram, sender) == (b"sample", device.getsockname())
        assert waited <= time.monotonic_ns() - before
        if waited >= least:
            return
    raise AssertionError("no datagram was stamped when it arrived")


def test_without_a_stamp_nothing_is_said_to_have_waited(pair: tuple[socket.socket, socket.socket]) -> None:
    device, here = pair
    leave_waiting(device, here)
    assert receive(here, 2048)[2] == 0


@pytest.mark.parametrize("step", [-3600.0, 3.0, 3600.0])
def test_a_wall_clock_that_was_set_meanwhile_says_nothing(
    pair: tuple[socket.socket, socket.socket], step: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    device, here = pair
    stamp_receipts(here)
    leave_waiting(device, here)
    monkeypatch.setattr(receipt, "_clock", receipt._WallClock())
    monkeypatch.setattr(receipt.time, "time_ns", lambda now=time.time_ns: now() + round(step * 1e9))
    assert receive(here, 2048)[2] == 0


def test_what_arrives_after_the_wall_clock_was_set_is_stamped_right_again(monkeypatch: pytest.MonkeyPatch) -> None:
    wall, elapsed = 1_790_000_000 * 10**9, 10**9
    monkeypatch.setattr(receipt.time, "time_ns", lambda: wall)
    monkeypatch.setattr(receipt.time, "monotonic_ns", lambda: elapsed)
    clock = receipt._WallClock()
    wall += 3 * 10**9
    assert clock.since(wall - 3 * 10**9 - WAIT) == 0
    wall, elapsed = wall + 2 * WAIT, elapsed + 2 * WAIT
    assert clock.since(wall - WAIT) == WAIT
    assert clock.since(wall - 3 * WAIT) == 0, "it was stamped before"


def test_a_process_that_was_interrupted_between_its_clocks_reads_them_again(monkeypatch: pytest.MonkeyPatch) -> None:
    wall, elapsed, interruptions = 1_790_000_000 * 10**9, 10**9, [0, WAIT, WAIT]

    def read_wall() -> int:
        nonlocal wall, elapsed
        before, interruption = wall, interruptions.pop() if interruptions else 0
        wall, elapsed = wall + interruption, elapsed + interruption
        return before

    monkeypatch.setattr(receipt.time, "time_ns", read_wall)
    monkeypatch.setattr(receipt.time, "monotonic_ns", lambda: elapsed)
    clock = receipt._WallClock()
    interruptions.append(WAIT)
    arrived, wall, elapsed = wall, wall + WAIT, elapsed + WAIT
    assert clock.since(arrived) == 2 * WAIT
