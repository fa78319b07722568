"""A driver only reads: all bytes that it sends must be allowed."""

from __future__ import annotations

from pathlib import Path

from cellwatt.errors import ConnectError
from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.rig import Rig, require
from cellwatt.testing.running import running
from cellwatt.testing.tap import tapped

_SHOWN = 200
_ATTEMPTS = 5


async def only_reads(rig: Rig, folder: Path) -> None:
    """Identify, run, survive a fault, stop: every byte sent is captured and must be allowed.

    If the transport cannot be captured, only the declaration of the class is checked.
    """
    require(
        bool(rig.driver.writes) == (rig.may_send is not None) or rig.transport is None,
        f"{rig.driver.__name__}.writes is {rig.driver.writes!r}, but the rig's may_send is "
        f"{'missing' if rig.may_send is None else 'present'}: declare both, or neither if nothing is sent",
    )
    if rig.transport is None:
        return
    async with EmulatedDevice(rig, folder) as device, tapped(device.address, rig.transport) as (address, sent):
        for attempt in range(_ATTEMPTS):
            try:
                await rig.make(address, CollectingInlet()).identify()
                break
            except ConnectError:  # a busy PC may keep the emulator from answering in time
                if attempt == _ATTEMPTS - 1:
                    raise
        async with running(rig, address) as source:
            await source.samples(10, "through the suite's tap")
            if "stall" in rig.emulator.faults:
                await device.inject(rig.fault("stall"))
                await source.samples(10, "after a stall")
    for data in sent:
        if data:
            require(
                rig.may_send is not None and rig.may_send(bytes(data)),
                f"sent to the device, and not allowed by may_send: {bytes(data[:_SHOWN])!r}",
            )
    require(rig.may_send is None or any(sent), f"nothing was sent, though writes declares {rig.driver.writes!r}")
