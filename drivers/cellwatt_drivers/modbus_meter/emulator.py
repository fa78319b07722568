"""Energy meters on a Modbus server: pymodbus's own, with a meter's registers and faults."""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, ClassVar

from pymodbus import FramerType
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from cellwatt.emulation import Emulator, Fault, Options
from cellwatt.emulation.faults import FaultKind
from cellwatt.emulation.port import host_and_port
from cellwatt.emulation.terminal import raw_terminal
from cellwatt.errors import ConfigError
from cellwatt_drivers.modbus_meter.emulated_meter import EmulatedMeter
from cellwatt_drivers.modbus_meter.meter_map import METERS, MeterMap, MeterName, load_map, packaged_map

CHUNK = 4096


@contextmanager
def virtual_line(link: Path | None = None) -> Iterator[tuple[str, str]]:
    """Paths of both ends of a serial line, the other one's as ``link``; must be entered on a running loop."""
    loop = asyncio.get_running_loop()
    with raw_terminal() as (one, path_one), raw_terminal(link) as (other, path_other):
        loop.add_reader(one, _pass_on, one, other)
        loop.add_reader(other, _pass_on, other, one)
        try:
            yield path_one, path_other
        finally:
            loop.remove_reader(one)
            loop.remove_reader(other)


def _pass_on(source: int, sink: int) -> None:
    try:
        os.write(sink, os.read(source, CHUNK))
    except BlockingIOError:
        return  # nobody reads the far end: its bytes are lost, as on a line


_FUNCTIONS = {"holding": 3, "input": 4}


class ModbusMeterEmulator(Emulator):
    """Meters of one make on one TCP port, or on a serial line (``pty`` or the path of a link to it).

    Listens on 127.0.0.1:5020 unless told otherwise; a pseudo-terminal knows no parity. Options: ``meter`` (a packaged
    map, ``eastron_sdm630``) or ``map`` (a file), ``unit`` (numbers on the line, comma-separated, 1; others are not
    answered), ``framing`` (``rtu``: RTU frames over TCP), ``energy`` (kWh that the import counter begins with),
    ``strict`` (``yes``: registers between values and cut values are refused).

    Faults strike answers. ``loss``: not sent; ``half_frame``: cut; ``garbage``: random bytes instead; ``delay``:
    late by ``seconds``; ``stall``: one answer waits for ``seconds``; ``disconnect``: the port is closed for
    ``seconds``. ``made`` counts requests for registers, ``sent`` whole answers, ``refused`` exceptions.
    """

    title: ClassVar[str] = "Modbus energy meter"
    usual_address: ClassVar[str] = "127.0.0.1:5020"
    usual_port = 502
    line = "line"
    faults: ClassVar[tuple[FaultKind, ...]] = ("delay", "loss", "garbage", "half_frame", "stall", "disconnect")

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``: one meter a source, all of one make."""
        first = sources[0]
        if len({(s.meter, s.map, s.framing) for s in sources}) > 1:
            raise ValueError("an emulated gateway has meters of one make")
        options = {"unit": ",".join(str(s.unit) for s in sources), "framing": first.framing}
        return options | ({"meter": first.meter} if first.meter else {"map": str(first.map)})

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        made = _map(options)
        energy = options.number("energy", 0.0) * 3.6e6
        self.meters = {int(n): EmulatedMeter(self.signals, made, energy) for n in options.numbers("unit", (1.0,))}
        self._framer = (
            FramerType.SOCKET if options.choice("framing", "tcp", ("tcp", "rtu")) == "tcp" else FramerType.RTU
        )
        self._strict = options.flag("strict", False)
        if self.on_terminal:
            self._framer = FramerType.RTU
        self._map = made
        self.tally.update(refused=0)
        self._outages: asyncio.Queue[Fault] = asyncio.Queue()

    def inject(self, fault: Fault) -> None:
        """See ``Emulator.inject``."""
        super().inject(fault)
        if fault.kind == "disconnect" and (outage := self.injector.once("disconnect")):
            self._outages.put_nowait(outage)

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        with ExitStack() as stack:
            if self.on_terminal:
                near, far = stack.enter_context(virtual_line(self.link))
            else:
                near, far = self.address, ""
            told = False
            while True:
                server = self._server(near)
                try:
                    await server.serve_forever(background=True)
                    if not told:
                        near = near if far else _bound(server)
                        ready(far or near)
                        told = True
                    outage = await self._outages.get()
                finally:
                    await server.shutdown()  # type: ignore[no-untyped-call]
                await asyncio.sleep(outage.seconds)

    def _server(self, place: str) -> ModbusTcpServer | ModbusSerialServer:
        devices = [self._device(unit, meter) for unit, meter in self.meters.items()]
        if place.startswith("/"):
            return ModbusSerialServer(devices, framer=self._framer, port=place, trace_packet=self._struck)
        return ModbusTcpServer(devices, framer=self._framer, address=host_and_port(place), trace_packet=self._struck)

    def _device(self, unit: int, meter: EmulatedMeter) -> SimDevice:
        first = min(s.address for s in meter.slots)
        last = max(s.end for s in meter.slots)
        data = [SimData(first, count=last - first, values=0, datatype=DataType.REGISTERS)]

        async def answer(
            function: int, start: int, address: int, count: int, registers: list[int], written: object
        ) -> ExcCodes | None:
            return await self._answer(meter, function, start, address, count, registers, written)

        return SimDevice(unit, simdata=data, action=answer)

    async def _answer(
        self,
        meter: EmulatedMeter,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        written: object,
    ) -> ExcCodes | None:
        self.tally["made"] += 1
        late = self.injector.strikes("delay", time.monotonic()) or self.injector.once("stall")
        if late:
            await asyncio.sleep(late.seconds)
        refusal = self._refusal(meter, function, address, count, written)
        if refusal is None:
            meter.write(time.time() - self.epoch, address, count, registers, start)
        return refusal

    def _refusal(
        self, meter: EmulatedMeter, function: int, address: int, count: int, written: object
    ) -> ExcCodes | None:
        known = set(_FUNCTIONS.values()) if self._map.both_functions else {_FUNCTIONS[self._map.function]}
        if written is not None or function not in known:
            return ExcCodes.ILLEGAL_FUNCTION
        if count > self._map.longest_read:
            return ExcCodes.ILLEGAL_VALUE
        if self._strict and (meter.cuts(address, count) or meter.gaps(address, count)):
            return ExcCodes.ILLEGAL_ADDRESS
        return None

    def _struck(self, sending: bool, data: bytes) -> bytes:
        """Return the bytes of an answer that reach the wire."""
        if not sending:
            return data
        unit, function = (data[6], data[7]) if self._framer is FramerType.SOCKET else (data[0], data[1])
        if unit not in self.meters:
            return b""
        now, strikes = time.monotonic(), self.injector.strikes
        if strikes("loss", now):
            return b""
        if strikes("half_frame", now):
            return data[: 1 + self.injector.below(len(data) - 1)]
        if strikes("garbage", now):
            return self.injector.random_bytes(1, 32)
        self.tally["refused" if function & 0x80 else "sent"] += 1
        return data


def _map(options: Options) -> MeterMap:
    name: MeterName = options.choice("meter", "eastron_sdm630", METERS)
    if not (file := options.text("map")):
        return packaged_map(name)
    try:
        return load_map(Path(file))
    except ConfigError as error:
        raise ValueError(str(error)) from error


def _bound(server: ModbusTcpServer | ModbusSerialServer) -> str:
    """Return the address, HOST:PORT, at which a running server listens."""
    listening = server.transport
    assert isinstance(listening, asyncio.Server)
    host, port = listening.sockets[0].getsockname()[:2]
    return f"{host}:{port}"
