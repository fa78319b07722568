"""A driver counts and reports faults, and continues."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

from cellwatt.emulation import Fault
from cellwatt.emulation.faults import ONE_SHOT, FaultKind
from cellwatt.testing.checks.stamps import times_are_right
from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.rig import NotConformingError, Rig
from cellwatt.testing.running import Running, running

SEEN: frozenset[FaultKind] = frozenset({"loss", "garbage", "half_frame", "disconnect"})
"""Faults that must leave a trace: they damage or drop a sample or a byte."""


async def survives(rig: Rig, folder: Path, *, kind: FaultKind) -> None:
    """Require that samples resume, the account balances, time rises, and the fault is reported."""
    fault = rig.fault(kind)
    async with EmulatedDevice(rig, folder) as device, running(rig, device.address) as source:
        await source.samples(rig.warm_up, "after the start")
        before = _traces(source)
        await device.inject(fault)
        await _strikes(device, source, fault)
        if kind not in ONE_SHOT:
            await device.inject(replace(fault, probability=0.0))
        await source.samples(10, f"after {kind}")
        if kind in SEEN:
            await source.until(
                lambda: _traces(source) != before,
                f"{kind} leaving a trace (account.miss, account.drop, account.count, inlet.event or a SourceError)",
            )
    times_are_right(source.inlet)


async def _strikes(device: EmulatedDevice, source: Running, fault: Fault) -> None:
    """Wait until the fault has struck."""
    end = asyncio.get_running_loop().time() + source.rig.patience
    while (await device.counts()).get(fault.kind, 0) < 1:
        source.verdict()
        if asyncio.get_running_loop().time() > end:
            raise NotConformingError(f"the emulator never injected {fault.kind}: counts {dict(await device.counts())}")
        await asyncio.sleep(0.01)


def _traces(source: Running) -> dict[str, Any]:
    account = source.inlet.account
    return {
        "missed": dict(account.missed),
        "dropped": dict(account.dropped),
        "counters": dict(account.counters),
        "failures": len(source.failures),
    }
