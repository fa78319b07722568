"""A controller with an OPC UA server that emulates an arm."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

from pydantic import ValidationError

from cellwatt.emulation import Emulator, Options, TcpPort
from cellwatt.emulation.faults import FaultKind
from cellwatt.emulation.relay import pass_on
from cellwatt.ticker import Ticker
from cellwatt_drivers.opc_ua.emulated_server import EmulatedServer, Entry
from cellwatt_drivers.opc_ua.messages import OVERFLOW
from cellwatt_drivers.opc_ua.tag_map import TagMap, packaged_map

_BAD = 0x808C_0000  # BadSensorFailure


class OpcUaEmulator(Emulator):
    """A server with the nodes of OPC 40010-1, or of other tags; it samples them and stamps them with its own clock.

    Options: ``rate`` (samples a second; 10), ``tags`` and ``namespaces`` (of its nodes, JSON as in a map), ``security``
    (``none``, ``sign``, ``encrypt``, several with commas), ``certificate`` and ``key`` (PEM files of the server),
    ``trusted`` (PEM file of the only client certificate that it accepts), ``user`` and ``password``.

    Faults strike samples of all tags. ``loss``: the values are overwritten in the queue, the next ones carry the
    overflow bit; ``duplicate``: the values carry the time stamps of the previous sample; ``garbage``: their status is
    BadSensorFailure; ``stall``: nothing is published for ``seconds``, then all that was due; ``disconnect``: the server
    restarts after ``seconds`` without its sessions and subscriptions; ``clock_jump``: its clock jumps by ``seconds``.
    ``made`` counts samples, ``sent`` those that were not lost.
    """

    title: ClassVar[str] = "Controller with an OPC UA server"
    usual_address: ClassVar[str] = "127.0.0.1:4840"
    faults: ClassVar[tuple[FaultKind, ...]] = ("loss", "duplicate", "garbage", "stall", "disconnect", "clock_jump")

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``: the tags of all sources, and their user."""
        tags: dict[str, Any] = {}
        namespaces: dict[str, str] = {}
        for s in sources:
            if s.security != "none":
                raise ValueError("an emulated server has no certificate: start one with its options")
            tags |= {name: tag.model_dump(mode="json") for name, tag in s.tag_map.values.items()}
            namespaces |= s.tag_map.namespaces
        options = {"rate": f"{max(s.rate for s in sources):g}"}
        options |= {"tags": json.dumps(tags), "namespaces": json.dumps(namespaces)}
        if sources[0].user:
            options |= {"user": sources[0].user, "password": sources[0].password.get_secret_value()}
        return options

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        self._rate = options.number("rate", 10.0)
        self._map = _map(options.text("tags"), options.text("namespaces"))
        modes = tuple(options.text("security", "none").split(","))
        if not set(modes) <= {"none", "sign", "encrypt"}:
            raise ValueError(f"security is none, sign or encrypt, not {', '.join(modes)}")
        files = {key: Path(text) if (text := options.text(key)) else None for key in ("certificate", "key", "trusted")}
        self._entry = Entry(modes=modes, user=options.text("user"), password=options.text("password"), **files)
        self._port = TcpPort(self, self._talk)
        self._flows = asyncio.Event()
        self._flows.set()
        self._offset = 0
        self._stamp = 0
        self._overflow = False
        self._stalled = 0.0

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        self._server = EmulatedServer(self._map, self._entry)
        await self._server.open()
        try:
            await self._sample(time.monotonic())
            async with self._port as address, Ticker(self._rate) as ticker:
                ready(address)
                async for _ in ticker:
                    await self._sample(time.monotonic())
        finally:
            await self._server.close()

    async def _sample(self, now: float) -> None:
        """Run one cycle of the controller."""
        once, strikes = self.injector.once, self.injector.strikes
        if outage := once("disconnect"):
            self._port.interrupt(outage.seconds)
            await self._server.forget()
        if stall := once("stall"):
            self._stalled = now + stall.seconds
            self._flows.clear()
        elif now >= self._stalled:
            self._flows.set()
        if jump := once("clock_jump"):
            self._offset += round(jump.seconds * 1e9)
        self.tally["made"] += 1
        if strikes("loss", now):
            self._overflow = True
            return
        stamp = self._stamp if strikes("duplicate", now) else time.time_ns() + self._offset
        status = _BAD if strikes("garbage", now) else OVERFLOW if self._overflow else 0
        self._overflow, self._stamp = False, stamp
        await self._server.set(self.world(), stamp, status)
        self.tally["sent"] += 1

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Relay data between a client and the server, except during a stall."""
        await pass_on(reader, writer, f"127.0.0.1:{self._server.port}", down=lambda _: self._flows.wait())


def _map(tags: str, namespaces: str) -> TagMap:
    if not tags:
        return packaged_map("opc_40010")
    try:
        return TagMap.model_validate({"values": json.loads(tags), "namespaces": json.loads(namespaces or "{}")})
    except (ValueError, ValidationError) as error:
        raise ValueError(f"tags and namespaces are JSON as in a map: {error}") from error
