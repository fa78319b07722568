"""One client's connection to the emulated controller."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from cellwatt.emulation.blocks import Blocks
from cellwatt.emulation.relay import MOST
from cellwatt.errors import ProtocolError
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.emulated_samples import Encoder
from cellwatt_drivers.ur.fields import FIELDS
from cellwatt_drivers.ur.wire import ControllerVersion, Kind

OUTPUTS = 1
"""Id of the only output recipe of a connection."""


@dataclass(slots=True)
class Listener:
    """A listener's state in the sequence of packages; it outlives the connection, so that losses are counted.

    ``next`` is the number of the next package; every ``stride``-th package is for this listener. ``made`` are its
    packages, encoded one after the other.
    """

    next: int
    stride: int
    client: EmulatedClient | None
    made: Blocks[bytes]

    @property
    def lost(self) -> bool:
        """True if no client receives this listener's packages."""
        return self.client is None or not self.client.listening


class EmulatedClient:
    """Answers one client's requests, and sends it data at once or after a hold.

    ``start`` is called when the client is to be sent its packages, ``stop`` when it is to be sent no more.
    """

    def __init__(
        self,
        writer: asyncio.StreamWriter,
        version: ControllerVersion,
        start: Callable[[EmulatedClient], None],
        stop: Callable[[EmulatedClient], None],
    ) -> None:
        self._writer = writer
        self._version = version
        self._start = start
        self._stop = stop
        self._spoken = 1  # protocol version
        self._held: list[tuple[bytes, int]] = []
        self.held_until = 0.0
        self.rate = 1.0
        self.encoder = Encoder(OUTPUTS, ())
        self.listener: Listener | None = None
        self.listening = True
        self.compares = False
        """The client requests only the timestamp: packages sent to it are not counted."""

    async def converse(self, reader: asyncio.StreamReader) -> None:
        """Answer all complete requests until the client disconnects, or sends data that are not RTDE."""
        rest = b""
        while data := await reader.read(MOST):
            rest, end = rest + data, 0
            try:
                for item, used in wire.scan(memoryview(rest), wire.FROM_CLIENT):
                    assert isinstance(item, wire.Frame)
                    self._answer(item.kind, item.payload)
                    end = used
            except ProtocolError:
                return
            rest = rest[end:]

    def _answer(self, kind: Kind, payload: bytes) -> None:
        match kind:
            case Kind.PROTOCOL_VERSION:
                accepted = int.from_bytes(payload, "big") == wire.PROTOCOL
                self._spoken = wire.PROTOCOL if accepted else self._spoken
                self.put(wire.accept_reply(kind, accepted))
            case Kind.CONTROLLER_VERSION:
                self.put(wire.controller_reply(self._version))
            case Kind.SETUP_OUTPUTS:
                self._set_up_outputs(payload)
            case Kind.START:
                ready = self.encoder.size > len("U") + 3
                self.put(wire.accept_reply(kind, ready))
                if ready and self.listener is None:
                    self._start(self)
            case Kind.PAUSE:
                self._stop(self)
                self.put(wire.accept_reply(kind, True))

    def _set_up_outputs(self, payload: bytes) -> None:
        if self._spoken != wire.PROTOCOL:
            raise ProtocolError("protocol version 1 is not emulated")
        self._stop(self)
        self.rate, names = wire.parse_ask_outputs(payload)
        known = [n in FIELDS and FIELDS[n].served_by(self._version) for n in names]
        types = [FIELDS[n].type if k else wire.NOT_FOUND for n, k in zip(names, known, strict=True)]
        self.encoder = Encoder(OUTPUTS, names if all(known) else ())
        self.compares = tuple(names) == ("timestamp",)
        self.put(wire.recipe_reply(Kind.SETUP_OUTPUTS, OUTPUTS if all(known) else 0, types))

    @property
    def unread(self) -> int:
        """Bytes that the client has not read, in the controller's send buffer."""
        return self._writer.transport.get_write_buffer_size()

    def put(self, data: bytes, packages: int = 0) -> int:
        """Write, or queue during a hold; returns the number of packages written now."""
        if not data or self._writer.is_closing():
            return 0
        if self.held_until:
            self._held.append((data, packages))
            return 0
        self._writer.write(data)
        return packages

    def hold(self, until: float) -> None:
        """Send nothing until then (monotonic s)."""
        self.held_until = max(self.held_until, until)

    def release(self, now: float) -> int:
        """Send the queued data if the hold is over; returns the number of packages written."""
        if not self.held_until or now < self.held_until:
            return 0
        self.held_until = 0.0
        held, self._held = self._held, []
        return sum(self.put(data, packages) for data, packages in held)

    def end(self) -> None:
        """Disconnect the client once it has received what was written; discard what is queued."""
        self.listening = False
        self._held.clear()
        self._writer.close()

    def abort(self) -> None:
        """Disconnect the client at once."""
        self._writer.transport.abort()
