"""A Modbus meter's map."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.resources import files

from cellwatt.errors import ConfigError
from cellwatt_drivers import modbus_meter
from cellwatt_drivers.modbus_meter.meter_map import METERS, chosen_map
from cellwatt_drivers.modbus_meter.registers import plan
from fuzz.target import Target, folder


def run(data: bytes) -> None:
    """As a file of the user's own."""
    path = folder() / "map.yaml"
    path.write_bytes(data)
    try:
        made = chosen_map(None, path)
    except ConfigError as error:
        assert error.problems
        assert all("\n" not in str(problem) for problem in error.problems)
        return
    names = tuple(made.values)
    for block in plan(made.slots(names), made.longest_read, made.gap, made.word_order):
        block.decode([0] * block.count)
    for name in names:
        made.values[name].channel(name, made.window)
        made.wrap(name)


def seeds() -> Iterable[bytes]:
    """The smallest packaged map, and one with every key."""
    packaged = [(files(modbus_meter) / "meters" / f"{name}.yaml").read_bytes() for name in METERS]
    yield min(packaged, key=len)
    yield (
        b"maker: M\nmodel: N\nsource: s\nfunction: input\ntype: float32\nword_order: little\nlongest_read: 40\n"
        b"gap: 4\nwindow: 0.2\nvalues:\n"
        b"  supply.voltage: {address: 0, unit: V, between: [180, 270], missing: [-1], largest: 1e9}\n"
        b"  supply.energy: {address: 0x20, unit: kWh, type: uint32, scale: 0.1, counter: true, wraps_at: 1e6}\n"
    )


TARGET = Target(run, seeds, 2048)
