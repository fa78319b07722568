"""One client's connection to the emulated controller."""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import dataclass
from typing import Protocol

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

    ``next`` is the number of the next package; every ``stride``-th package is for this listener.
    """

    next: int
    stride: int
    client: EmulatedClient | None
    first: int = 0
    made: bytes = b""
    """Packages made ahead, from number ``first`` on; empty if they are out of date."""

    @property
    def lost(self) -> bool:
        """True if no client receives this listener's packages."""
        return self.client is None or not self.client.listening


class Controller(Protocol):
    """The emulated controller as its connections use it."""

    version: ControllerVersion
    clients: set[EmulatedClient]
    tally: Counter[str]

    @property
    def down(self) -> bool:
        """True while connections are refused."""
        ...

    def start(self, client: EmulatedClient) -> None:
        """Send the client its packages from now on."""
        ...

    def stop(self, client: EmulatedClient) -> None:
        """Send the client no more packages."""
        ...

    def lost(self, client: EmulatedClient) -> None:
        """Remove a client whose connection is closed."""
        ...


class EmulatedClient(asyncio.Protocol):
    """One client's connection to the emulated controller."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._rest = b""
        self._spoken = 1  # protocol version
        self._held: list[tuple[bytes, int]] = []
        self._ending = False
        self._transport: asyncio.Transport | None = None
        self.held_until = 0.0
        self.rate = 1.0
        self.encoder = Encoder(OUTPUTS, ())
        self.listener: Listener | None = None
        self.listening = True
        self.compares = False
        """The client requests only the timestamp: packages sent to it are not counted."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept the connection, or abort it while the controller is down."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        if self._controller.down:
            transport.abort()
        else:
            self._controller.clients.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the client."""
        self._controller.lost(self)

    def data_received(self, data: bytes) -> None:
        """Answer all complete requests; disconnect a client that does not speak RTDE."""
        self._rest += data
        end = 0
        try:
            for item, used in wire.scan(memoryview(self._rest), wire.FROM_CLIENT):
                assert isinstance(item, wire.Frame)
                self._answer(item.kind, item.payload)
                end = used
        except ProtocolError:
            self.abort()
        self._rest = self._rest[end:]

    def _answer(self, kind: Kind, payload: bytes) -> None:
        match kind:
            case Kind.PROTOCOL_VERSION:
                accepted = int.from_bytes(payload, "big") == wire.PROTOCOL
                self._spoken = wire.PROTOCOL if accepted else self._spoken
                self.put(wire.accept_reply(kind, accepted))
            case Kind.CONTROLLER_VERSION:
                self.put(wire.controller_reply(self._controller.version))
            case Kind.SETUP_OUTPUTS:
                self._set_up_outputs(payload)
            case Kind.START:
                ready = self.encoder.size > len("U") + 3
                self.put(wire.accept_reply(kind, ready))
                if ready and self.listener is None:
                    self._controller.start(self)
            case Kind.PAUSE:
                self._controller.stop(self)
                self.put(wire.accept_reply(kind, True))

    def _set_up_outputs(self, payload: bytes) -> None:
        if self._spoken != wire.PROTOCOL:
            raise ProtocolError("protocol version 1 is not emulated")
        self._controller.stop(self)
        self.rate, names = wire.parse_ask_outputs(payload)
        version = self._controller.version
        known = [n in FIELDS and FIELDS[n].served_by(version) for n in names]
        types = [FIELDS[n].type if k else wire.NOT_FOUND for n, k in zip(names, known, strict=True)]
        self.encoder = Encoder(OUTPUTS, names if all(known) else ())
        self.compares = tuple(names) == ("timestamp",)
        self.put(wire.recipe_reply(Kind.SETUP_OUTPUTS, OUTPUTS if all(known) else 0, types))

    @property
    def unread(self) -> int:
        """Bytes that the client has not read, in the controller's send buffer."""
        return self._transport.get_write_buffer_size() if self._transport is not None else 0

    def put(self, data: bytes, packages: int = 0) -> int:
        """Write, or queue during a hold; returns the number of packages written now."""
        if not data or self._transport is None or self._transport.is_closing() or self._ending:
            return 0
        if self.held_until:
            self._held.append((data, packages))
            return 0
        self._transport.write(data)
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
        """Close with a FIN, so that data already written arrives; a reset could overtake it."""
        self.listening = False
        if self._transport is None or self._ending:
            return
        self._ending = True
        self._held.clear()
        if self._transport.can_write_eof() and not self._transport.is_closing():
            self._transport.write_eof()
            asyncio.get_running_loop().call_later(1.0, self.abort)

    def abort(self) -> None:
        """Close the connection at once."""
        if self._transport is not None:
            self._transport.abort()
