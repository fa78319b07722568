"""Values arrive in the units that their channels declare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.emulation import ArmSignals
from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.rig import Rig, require
from cellwatt.testing.running import running

_SMALL = 0.05
"""Smallest reference for ``accuracy``: values nearer to 0 are coarse on many devices."""


@dataclass(frozen=True)
class StandingSignals:
    """Signals with constant values."""

    values: Mapping[str, float]

    def at(self, t: Float) -> Mapping[str, Float]:
        """See ``Signals.at``."""
        return {name: np.full(len(t), value) for name, value in self.values.items()}

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """Refuse every disturbance: these signals are constant."""
        raise ValueError(f"a standing world cannot be disturbed ({', '.join(change)})")


async def values_are_in_their_units(rig: Rig, folder: Path) -> None:
    """Require that a channel named like a signal of the emulator has that signal's value."""
    moment = ArmSignals(noise=0.0).at(np.array([0.4]))  # in the middle of a move
    world = StandingSignals({name: float(values[0]) for name, values in moment.items()})
    async with EmulatedDevice(rig, folder, world) as device, running(rig, device.address) as source:
        await source.samples(10, "after the start")
    for stream in source.driver.streams:
        for channel in stream.channels:
            truth = world.values.get(channel.name)
            found = source.inlet.channel(channel.name)
            found = found[np.isfinite(found)]
            if truth is None or not len(found):
                continue
            value = float(np.median(found))
            require(
                abs(value - truth) <= rig.accuracy * max(abs(truth), _SMALL),
                f"{channel.name}: {value:g} {channel.unit} received, the device has {truth:g} {channel.unit}: "
                "is it converted to SI units?",
            )
