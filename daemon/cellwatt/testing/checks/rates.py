"""What is declared is delivered."""

from __future__ import annotations

import asyncio
from pathlib import Path

from cellwatt.channel import Stream
from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.outlet import CollectingOutlet
from cellwatt.testing.rig import Rig, require
from cellwatt.testing.running import running

_SPAN = 1.5
"""s over which a rate is taken, or …"""
_PERIODS = 15
"""… so many periods, whichever is longer."""
_TOLERANCE = 0.15
"""As a share of the declared rate, beside two samples at the ends."""


async def keeps_its_rates(rig: Rig, folder: Path) -> None:
    """Each stream comes at the rate that it declares, but for samples that the account says were missed."""
    async with EmulatedDevice(rig, folder) as device, running(rig, device.address) as source:
        streams = [s for s in source.driver.streams if s.rate]
        await source.until(lambda: all(source.outlet.of(s.name) for s in streams), "one sample of each stream")
        begins = {s.name: _count(source.outlet, s) for s in streams}
        missed = source.outlet.account.missed.total()
        loop = asyncio.get_running_loop()
        start = loop.time()
        await asyncio.sleep(max([_SPAN, *(_PERIODS / s.rate for s in streams)]))
        span = loop.time() - start
        missed = source.outlet.account.missed.total() - missed
        counts = {s.name: _count(source.outlet, s) - begins[s.name] for s in streams}
    for stream in streams:
        _is_kept(stream, counts[stream.name], missed, span)


def _count(outlet: CollectingOutlet, stream: Stream) -> int:
    return sum(len(r.values) for r in outlet.of(stream.name))


def _is_kept(stream: Stream, count: int, missed: int, span: float) -> None:
    due = stream.rate * span
    slack = _TOLERANCE * due + 2
    require(
        count + missed >= due - slack and count <= due + slack,
        f"{stream.name} is declared at {stream.rate:g} Hz: in {span:.2f} s {due:.0f} samples are due, but {count} came "
        f"and {missed} are accounted as missed",
    )
