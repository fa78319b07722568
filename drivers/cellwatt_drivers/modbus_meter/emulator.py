"""Emulates energy meters of one model at a Modbus address."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from cellwatt.emulation import Options, PortEmulator
from cellwatt_drivers.modbus_meter.emulated_meter import EmulatedMeter
from cellwatt_drivers.modbus_meter.meter_map import METERS, MeterName, chosen_map
from cellwatt_drivers.shared.modbus import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE
from cellwatt_drivers.shared.modbus_server import modbus_port

_FUNCTIONS = {"holding": 3, "input": 4}


class ModbusMeterEmulator(PortEmulator):
    """Meters of one model on one TCP port, or on a serial line (``pty`` or the path of a link to it).

    Listens on 127.0.0.1:5020 by default; a pseudo-terminal has no parity. Options: ``meter`` (a packaged map,
    ``eastron_sdm630``) or ``map`` (a file), ``unit`` (unit numbers on the line, comma-separated, 1; others are not
    answered), ``framing`` (``rtu``: RTU frames over TCP), ``energy`` (kWh at which the import counter starts),
    ``strict`` (``yes``: registers between values and partial values are refused).

    Faults strike answers. ``loss``: not sent; ``half_frame``: cut; ``garbage``: random bytes before it; ``delay``: late
    by ``seconds``. At the next request, ``stall`` delays the answer by ``seconds``; ``disconnect`` closes the port for
    ``seconds``, on a serial line all bytes are then lost. ``made`` counts answers, ``sent`` whole ones, ``refused``
    those that are exceptions.
    """

    title: ClassVar[str] = "Modbus energy meter"
    usual_address: ClassVar[str] = "127.0.0.1:5020"
    line = "line"

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``: one meter per source, all of one model."""
        first = sources[0]
        if len({(s.meter, s.map, s.framing) for s in sources}) > 1:
            raise ValueError("an emulated gateway has meters of one make")
        options = {"unit": ",".join(str(s.unit) for s in sources), "framing": first.framing}
        return options | ({"meter": first.meter} if first.meter else {"map": str(first.map)})

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        name: MeterName = options.choice("meter", "eastron_sdm630", METERS)
        file = options.text("map")
        self._map = chosen_map(name, Path(file) if file else None)
        energy = options.number("energy", 0.0) * 3.6e6
        units = options.numbers("unit", (1.0,))
        self.meters = {int(number): EmulatedMeter(self.signals, self._map, energy) for number in units}
        self._strict = options.flag("strict", False)
        rtu = options.choice("framing", "tcp", ("tcp", "rtu")) == "rtu"
        self.port = modbus_port(self, self._read, rtu=rtu)

    def _read(self, unit: int, function: int, address: int, count: int) -> list[int] | int | None:
        meter = self.meters.get(unit)
        if meter is None:
            return None
        if function not in (_FUNCTIONS.values() if self._map.both_functions else (_FUNCTIONS[self._map.function],)):
            return ILLEGAL_FUNCTION
        if not 1 <= count <= self._map.longest_read:
            return ILLEGAL_VALUE
        if (self._strict and meter.cuts(address, count)) or not meter.has(address, count):
            return ILLEGAL_ADDRESS
        return meter.read(self.elapsed, address, count)
