"""Datagrams leave as their faults say, and what left is counted."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from cellwatt.emulation import Datagrams, Fault

from .device import Device

FRAMES = [bytes([n]) * 8 for n in range(1, 4)]


@contextmanager
def listened(device: Device, **options) -> Iterator[tuple[Datagrams, socket.socket]]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.setblocking(False)
        made = Datagrams(device, **options)
        with made.opened("127.0.0.1"):
            made.to = listener.getsockname()
            yield made, listener


def come(listener: socket.socket) -> list[bytes]:
    """On the loopback interface a datagram is there when it was sent."""
    found = []
    while True:
        try:
            found.append(listener.recv(2048))
        except BlockingIOError:
            return found


@pytest.mark.parametrize(
    ("kind", "expected", "sent"),
    [
        ("loss", [], 0),
        ("duplicate", [f for f in FRAMES for _ in range(2)], 3),
        ("reorder", [], 0),
    ],
)
def test_what_strikes_each(kind, expected, sent) -> None:
    device = Device()
    device.inject(Fault(kind))
    with listened(device) as (made, listener):
        for frame in FRAMES:
            made.put(frame)
        assert come(listener) == expected
    assert device.counts == {"made": 0, "sent": sent, kind: 3}


def test_one_that_is_held_back_leaves_after_the_next() -> None:
    device = Device()
    with listened(device) as (made, listener):
        device.inject(Fault("reorder"))
        made.put(FRAMES[0])
        device.inject(Fault("reorder", probability=0.0))
        made.put(FRAMES[1])
        assert come(listener) == [FRAMES[1], FRAMES[0]]
    assert device.counts["sent"] == 2


def test_half_a_frame_is_shorter_than_cut_says_and_garbage_is_fit() -> None:
    device = Device()
    with listened(device, cut=lambda frame: 4, garbage=lambda noise: b"!" + noise) as (made, listener):
        device.inject(Fault("half_frame"))
        for _ in range(50):
            made.put(FRAMES[0])
        halves = come(listener)
        device.inject(Fault("half_frame", probability=0.0))
        device.inject(Fault("garbage"))
        made.put(FRAMES[1])
        noise, whole = come(listener)
    assert {len(half) for half in halves} == {1, 2, 3}
    assert noise[:1] == b"!"
    assert whole == FRAMES[1]
    assert device.counts["sent"] == 1


async def test_a_stall_keeps_them_and_lets_all_go_at_once() -> None:
    device = Device()
    device.inject(Fault("stall", seconds=3600.0))
    with listened(device) as (made, listener):
        made.put(FRAMES[0])
        made.put(FRAMES[1])
        assert come(listener) == []
        device.inject(Fault("stall", seconds=0.0))
        made.put(FRAMES[2])
        assert come(listener) == FRAMES


async def test_nobody_listens_and_somebody_speaks() -> None:
    device = Device()
    heard: asyncio.Queue[tuple[bytes, object]] = asyncio.Queue()
    with listened(device, take=lambda *told: heard.put_nowait(told)) as (made, listener):
        made.put(FRAMES[0])
        _, place = listener.recvfrom(2048)
        listener.sendto(b"?", place)
        assert await heard.get() == (b"?", listener.getsockname())
        made.to = None
        made.put(FRAMES[1])
        assert come(listener) == []
