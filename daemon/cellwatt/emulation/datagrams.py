"""Datagrams that an emulated device sends by itself, and the faults that strike them."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from cellwatt.emulation.emulator import Emulator

_LONGEST = 2048


class Datagrams:
    """Sends one emulator's datagrams ``to`` one listener; ``None``: to nobody.

    Faults: ``loss``, ``half_frame``, ``reorder`` (held back until after the next), ``delay`` (sent late), ``garbage``
    (random bytes ahead), ``duplicate``, ``stall`` (nothing leaves for a time, then all at once). A half frame is
    shorter than ``cut`` says (than the whole), ``garbage`` makes random bytes fit for the wire. Whole ones that left
    are counted as ``sent``, those that no listener took as ``unheard``.
    """

    def __init__(
        self, emulator: Emulator, cut: Callable[[bytes], int] = len, garbage: Callable[[bytes], bytes] = bytes
    ) -> None:
        self.to: tuple[str, int] | None = None
        self._injector = emulator.injector
        self._tally = emulator.tally
        self._cut = cut
        self._garbage = garbage
        self._socket: socket.socket | None = None
        self._held: list[bytes] = []
        self._stalled: list[bytes] = []
        self._stalled_until = 0.0

    @contextmanager
    def opened(self, host: str) -> Iterator[None]:
        """Inside, they can be sent, from an address of this PC. Raises ``OSError``."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as self._socket:
            self._socket.setblocking(False)
            self._socket.bind((host, 0))
            try:
                yield
            finally:
                self.to = None

    def heard(self) -> bool:
        """Whether the listener sent something."""
        assert self._socket is not None
        try:
            self._socket.recvfrom(_LONGEST)
        except OSError:  # nothing came, or word that nobody listens
            return False
        return True

    def put(self, frame: bytes) -> None:
        """Send one that is due now, as the faults have it."""
        now, strikes = time.monotonic(), self._injector.strikes
        if stall := self._injector.once("stall"):
            self._stalled_until = now + stall.seconds
        if strikes("loss", now):
            return
        if strikes("half_frame", now):
            self._send(frame[: 1 + self._injector.below(self._cut(frame) - 1)], whole=False)
            return
        if strikes("reorder", now):
            self._held.append(frame)
            return
        if late := strikes("delay", now):
            asyncio.get_running_loop().call_later(late.seconds, self._send, frame)
            return
        if strikes("garbage", now):
            self._send(self._garbage(self._injector.random_bytes(1, 200)), whole=False)
        self._send(frame)
        if strikes("duplicate", now):
            self._send(frame, whole=False)
        held, self._held = self._held, []
        for older in held:
            self._send(older)

    def _send(self, frame: bytes, whole: bool = True) -> None:
        self._tally["sent"] += whole
        if time.monotonic() < self._stalled_until:
            self._stalled.append(frame)
            return
        waiting, self._stalled = self._stalled, []
        for each in (*waiting, frame):
            if self._socket is None or self.to is None:
                return
            try:
                self._socket.sendto(each, self.to)
            except OSError:  # the listener is gone, or does not keep up
                self._tally["unheard"] += 1
