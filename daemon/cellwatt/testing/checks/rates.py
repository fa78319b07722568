"""A driver delivers the rates that it declares."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path

from cellwatt.channel import Stream
from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.rig import Rig, require
from cellwatt.testing.running import running

_SPAN = 1.5
"""Shortest time over which a rate is measured, s, and …"""
_PERIODS = 15
"""… fewest periods; the longer one applies."""
_TRIES = 4
"""Attempts: on a busy machine the emulator may miss its own rate, so one good attempt suffices."""
_TOLERANCE = 0.15
"""Tolerance as a share of the declared rate, in addition to two samples."""


async def keeps_its_rates(rig: Rig, folder: Path) -> None:
    """Require that each stream has its declared rate, apart from samples counted as missed."""
    async with EmulatedDevice(rig, folder) as device, running(rig, device.address) as source:
        streams = [s for s in source.driver.streams if s.rate]
        await source.until(lambda: all(source.inlet.of(s.name) for s in streams), "one sample of each stream")
        wrong = ""
        for _ in range(_TRIES):
            wrong = await _wrong(source.inlet, streams)
            if not wrong:
                break
    require(not wrong, wrong)


async def _wrong(inlet: CollectingInlet, streams: Sequence[Stream]) -> str:
    """Describe streams whose rate differs from the declared one within a time span; empty if none does."""
    loop = asyncio.get_running_loop()
    begins, missed, start = {s.name: _count(inlet, s) for s in streams}, inlet.account.missed.total(), loop.time()
    await asyncio.sleep(max([_SPAN, *(_PERIODS / s.rate for s in streams)]))
    span, missed = loop.time() - start, inlet.account.missed.total() - missed
    told = (_not_kept(s, _count(inlet, s) - begins[s.name], missed, span) for s in streams)
    return "; ".join(filter(None, told))


def _count(inlet: CollectingInlet, stream: Stream) -> int:
    return sum(len(r.values) for r in inlet.of(stream.name))


def _not_kept(stream: Stream, count: int, missed: int, span: float) -> str:
    due = stream.rate * span
    slack = _TOLERANCE * due + 2
    if count + missed >= due - slack and count <= due + slack:
        return ""
    return (
        f"{stream.name} is declared at {stream.rate:g} Hz: in {span:.2f} s {due:.0f} samples are due, but {count} came "
        f"and {missed} are accounted as missed"
    )
