"""Pages of Robot Web Services."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from cellwatt.errors import ProtocolError
from cellwatt_drivers.abb import rws
from cellwatt_drivers.abb.rws import Item
from fuzz.target import Target


def run(data: bytes) -> None:
    """As every page."""
    with suppress(ProtocolError):
        for item in rws.items(data):
            assert isinstance(item.kind, str)
    for name in ("ctrlstate", "ctrlexecstate", "opmode"):
        with suppress(ProtocolError):
            assert isinstance(rws.value(data, name), str)
    with suppress(ProtocolError):
        rws.ratio(data)
    with suppress(ProtocolError):
        energy = rws.energy(data, "ROB_1")
        assert energy.count == energy.count
        assert all(isinstance(joint, float) for joint in energy.joints)


def seeds() -> Iterable[bytes]:
    """Each page that is read."""
    yield rws.page("state", [Item("pnl-ctrlstate", "ctrlstate", {"ctrlstate": "motoron"})])
    yield rws.page("speed", [Item("pnl-speedratio", "speedratio", {"speedratio": "75"})])
    state = {
        "state": "0", "energy-state": "ready", "change-count": "4", "interval-length": "60.0",
        "interval-energy": "12.5", "accumulated-energy": "10000.0",
    }  # fmt: skip
    axes = tuple(Item("sys-energy-axis", f"{i}", {"interval-energy": f"{1.5 * i}"}) for i in range(1, 4))
    unit = Item("sys-energy-mec", "ROB_1", {}, inside=axes)
    yield rws.page("energy", [Item("sys-energy-state", "state", state), unit])
    yield b'<?xml version="1.0" encoding="latin-1"?><!DOCTYPE a [<!ENTITY b "c">]><li class="&b;">&b;</li>'


TARGET = Target(run, seeds, 2048)
