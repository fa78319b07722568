"""The socket of a connection: what gathers comes as one block, at the time at which the kernel got it."""

from __future__ import annotations

import asyncio
import select
import socket
import time
from collections.abc import Iterator

import pytest

from cellwatt import receipt
from cellwatt.account import Account
from cellwatt.errors import ConnectError
from cellwatt.receipt import receive_into, stamp_receipts
from cellwatt_drivers.ur import session, wire
from cellwatt_drivers.ur.session import Session
from tests.patience import eventually

NOW = 1_790_000_000_000_000_000


class Heard(Session):
    """Keeps what came and how long it had waited, frames or not; the cell's time stands still."""

    def __init__(self, opened: socket.socket, gather: float) -> None:
        self.blocks: list[tuple[bytes, int]] = []
        super().__init__(opened, "here", lambda: NOW, Account(), lambda: gather)

    def _take(self) -> bool:
        self.blocks.append((bytes(self._view[: self._filled]), NOW - self._arrival))
        self._filled = 0
        return False


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        ours = socket.create_connection(server.getsockname())
        theirs, _ = server.accept()
        ours.setblocking(False)
        theirs.setblocking(False)
        # Else the kernel holds back a second small segment until the first is acknowledged, which may take it 40 ms.
        theirs.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with ours, theirs:
            yield ours, theirs


def await_stamps(ours: socket.socket, theirs: socket.socket) -> None:
    """The kernel begins to stamp what arrives a little after it was asked to."""
    assert stamp_receipts(ours)
    waited = 0
    while not waited:
        theirs.send(b"early")
        select.select([ours], [], [], 10)
        _, waited = receive_into(ours, memoryview(bytearray(100)))


async def test_what_gathers_is_one_block_that_says_how_long_its_newest_bytes_waited(pair, monkeypatch):
    ours, theirs = pair
    await_stamps(ours, theirs)
    monkeypatch.setattr(receipt, "_clock", receipt._WallClock())  # the PC's clock may have been set since the last use
    begun = time.monotonic_ns()
    for part in (b"one", b"two", b"three"):
        theirs.send(part)
    while select.select([ours], [], [], 10)[0] and len(ours.recv(100, socket.MSG_PEEK)) < len(b"onetwothree"):
        pass  # a busy kernel delivers late
    there = time.monotonic_ns()
    moment = asyncio.get_running_loop().time() + 0.05
    monkeypatch.setattr(session, "next_moment", lambda gather: moment)
    heard = Heard(ours, 0.01)
    await eventually(lambda: heard.blocks)
    read = time.monotonic_ns()
    ((data, waited),) = heard.blocks
    assert data == b"onetwothree"
    assert 0.5 * (int(moment * 1e9) - there) < waited <= read - begun
    heard.close()


async def test_without_a_gather_bytes_are_read_as_they_come_and_the_end_is_told(pair):
    ours, theirs = pair
    heard = Heard(ours, 0.0)
    heard.leave()
    assert await asyncio.get_running_loop().sock_recv(theirs, 100) == wire.PAUSE
    for n, part in enumerate((b"one", b"two"), 1):
        theirs.send(part)
        await eventually(lambda n=n: len(heard.blocks) == n)
    assert [data for data, _ in heard.blocks] == [b"one", b"two"]
    theirs.close()
    await eventually(heard.closed.done)
    with pytest.raises(ConnectError, match="here: the controller closed the connection"):
        heard.closed.result()
    assert ours.fileno() < 0
