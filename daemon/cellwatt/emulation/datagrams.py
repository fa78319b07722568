"""The UDP port of an emulated device, and the faults that strike its datagrams."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from cellwatt.emulation.emulator import Emulator

Address: TypeAlias = tuple[str, int]

_LONGEST = 2048
_EARLY = 0.001
"""Longest time, s, by which a timer of the loop may fire early."""


class Datagrams:
    """Sends the datagrams of one emulator, and passes received datagrams to ``take``, with their sender.

    Faults: ``loss``, ``half_frame``, ``reorder`` (held back until after the next), ``delay`` (sent late), ``garbage``
    (random bytes first), ``duplicate``, ``stall`` (nothing is sent for a time, then all at once). A half frame is
    shorter than ``cut`` of the frame (default: its length); ``garbage`` makes random bytes fit for the wire. ``sent``
    counts whole datagrams sent, ``unheard`` those that no listener received.
    """

    def __init__(
        self,
        emulator: Emulator,
        cut: Callable[[bytes], int] = len,
        garbage: Callable[[bytes], bytes] = bytes,
        take: Callable[[bytes, Address], object] | None = None,
    ) -> None:
        self.to: Address | None = None
        """Receiver of datagrams that ``put`` gets without an address; ``None``: they are not sent."""
        self._injector = emulator.injector
        self._tally = emulator.tally
        self._cut = cut
        self._garbage = garbage
        self._take = take
        self._place: Address | None = None
        self._socket: socket.socket | None = None
        self._held: list[tuple[bytes, Address | None]] = []
        self._stalled: list[tuple[bytes, Address | None]] = []
        self._stalled_until = 0.0

    @contextmanager
    def opened(self, host: str, port: int = 0) -> Iterator[str]:
        """Open the port (0: any free one) at an address of this PC; yields its real address. Raises ``OSError``."""
        self._place = host, port
        self._open()
        try:
            yield f"{self._place[0]}:{self._place[1]}"
        finally:
            self.to = self._place = None
            self._close()

    def interrupt(self, seconds: float) -> None:
        """Close the port for ``seconds`` s."""
        self._close()
        asyncio.get_running_loop().call_later(seconds, self._open)

    def _open(self) -> None:
        if self._place is None or self._socket is not None:
            return
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(self._place)
        self._place = self._socket.getsockname()
        if self._take is not None:
            asyncio.get_running_loop().add_reader(self._socket, self._readable, self._socket, self._take)

    def _close(self) -> None:
        if self._socket is not None:
            if self._take is not None:
                asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _readable(self, opened: socket.socket, take: Callable[[bytes, Address], object]) -> None:
        try:
            datagram, sender = opened.recvfrom(_LONGEST)
        except OSError:  # no datagram after all, or an ICMP error: an earlier one had no receiver
            return
        take(datagram, sender)

    def put(self, frame: bytes, to: Address | None = None, after: float = 0.0) -> None:
        """Send a datagram in ``after`` s, unless a fault strikes it."""
        now = time.monotonic()
        to = to or self.to
        if stall := self._injector.once("stall"):
            self._stalled_until = now + stall.seconds
            asyncio.get_running_loop().call_later(stall.seconds, self._leave, [])
        if self._injector.strikes("reorder", now):
            self._held.append((frame, to))
            return
        pieces, whole, late = self._injector.left_of(frame, self._cut, self._garbage)
        self._send(pieces, to, after + late, int(whole))

    def _send(self, frames: list[bytes], to: Address | None, after: float, whole: int) -> None:
        if after > 0:
            asyncio.get_running_loop().call_later(after, self._send, frames, to, 0.0, whole)
            return
        if self._socket is None:
            return
        held = self._held if whole else []
        self._held = self._held[len(held) :]
        self._tally["sent"] += whole + len(held)
        self._leave([*((frame, to) for frame in frames), *held])

    def _leave(self, datagrams: list[tuple[bytes, Address | None]]) -> None:
        self._stalled += datagrams
        if time.monotonic() < self._stalled_until - _EARLY:
            return
        waiting, self._stalled = self._stalled, []
        for datagram, to in waiting:
            if self._socket is None or to is None:
                continue
            try:
                self._socket.sendto(datagram, to)
            except OSError:  # the listener has closed its port, or is too slow
                self._tally["unheard"] += 1
