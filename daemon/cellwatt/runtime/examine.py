"""Reads one source for some seconds and reports what works: the maths and I/O behind ``cellwatt doctor``."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from cellwatt.batch import Batch
from cellwatt.channel import Quality
from cellwatt.clock.cell import CellClock
from cellwatt.config import SourceConfig
from cellwatt.errors import SourceError
from cellwatt.registry import driver as find_driver
from cellwatt.results import Event
from cellwatt.runtime.source import Source

log = logging.getLogger(__name__)

RATE_TOLERANCE = 0.02
"""Largest relative deviation of the measured rate from the declared one."""
CLOCK_TOLERANCE = 0.1
"""Largest bound in s; a bound above this, and above half the time between two samples, is reported."""
SETTLING = 15.0
"""Longest additional time in s until a device's clock is learned."""
MOST_EVENTS = 8
"""Kinds of events of one source that are reported; the others are counted."""
HARMLESS = frozenset(
    {"message", "mode", "rate", "state", "controller_alarm_cleared", "counter_wrapped", "energy_valid"}
)
"""Kinds of events that are reported without a warning, beside those that end in ``_state``."""


@dataclass
class ChannelCheck:
    """Values of one channel: finite share of its samples, range, unit."""

    name: str
    unit: str
    finite: float
    low: float | None
    high: float | None


@dataclass
class Examination:
    """Findings of ``doctor`` about one source. ``verdict`` is ``ok``, ``warning`` or ``failed``."""

    name: str
    driver: str
    verdict: str
    findings: list[str] = field(default_factory=list)
    status: dict[str, Any] = field(default_factory=dict)
    channels: list[ChannelCheck] = field(default_factory=list)


async def examine(config: SourceConfig, seconds: float, patience: float) -> Examination:
    """Identify a device, read it for ``seconds``, and judge it. Opens it read-only.

    The device must answer within ``patience`` s.
    """
    clock = CellClock()
    batches: list[Batch] = []
    events: list[Event] = []
    driver = find_driver(config.driver)
    source = Source(config.name, driver, config.settings, clock.now, batches.append, events.append)
    result = Examination(config.name, config.driver, "ok")
    try:
        async with asyncio.timeout(patience):
            result.status["identity"] = asdict(await source.driver.identify())
    except TimeoutError:
        return _failed(result, f"no answer within {patience:g} s")
    except SourceError as error:
        return _failed(result, str(error))
    except Exception as error:
        log.exception("%s: the %s driver failed", config.name, config.driver)
        return _failed(result, f"the {config.driver} driver failed: {type(error).__name__}: {error}")
    reading = asyncio.create_task(source.driver.run())
    try:
        done, _ = await asyncio.wait({reading}, timeout=seconds)
        if not done:
            done = await _settle(source, reading)
        if done:
            failure = None if reading.cancelled() else reading.exception()
            _failed(result, f"reading stopped: {failure or 'the driver ended without being stopped'}")
    finally:
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
    identity = result.status["identity"]
    result.status = source.status() | {"identity": identity, "events": [e.text for e in events]}
    result.status["bounds_ms"] = {s.name: _bound(s.name, source, batches) for s in source.driver.streams}
    result.channels = [check for s in source.driver.streams for check in _channels(s.name, batches)]
    _judge(result)
    _add_events(result, events)
    return result


async def _settle(source: Source, reading: asyncio.Task[None]) -> set[asyncio.Task[None]]:
    """Continue reading while the bound of a device's clock is too wide; return the task if it ends."""
    loop = asyncio.get_running_loop()
    until = loop.time() + SETTLING
    while loop.time() < until and any(
        clock.state().samples and clock.state().bound_ns * 1e-9 > CLOCK_TOLERANCE for clock in source.clocks.values()
    ):
        done, _ = await asyncio.wait({reading}, timeout=0.25)
        if done:
            return done
    return set()


def _bound(stream: str, source: Source, batches: list[Batch]) -> float | None:
    """Largest error of this stream's stamps, ms: at present if the device has a clock, else of 99 % of the samples."""
    mine = [b.bound for b in batches if b.stream.name == stream]
    if not mine:
        return None
    if stream in source.clocks:
        return source.clocks[stream].state().bound_ns * 1e-6
    return float(np.quantile(np.concatenate(mine), 0.99)) * 1e-6


def _failed(result: Examination, text: str) -> Examination:
    result.verdict = "failed"
    result.findings.append(text)
    return result


def _channels(stream: str, batches: list[Batch]) -> list[ChannelCheck]:
    mine = [b for b in batches if b.stream.name == stream]
    if not mine:
        return []
    values = np.concatenate([np.where((b.quality == Quality.MISSING)[:, None], np.nan, b.values) for b in mine])
    checks = []
    for channel, column in zip(mine[0].stream.channels, values.T, strict=True):
        good = column[np.isfinite(column)]
        low, high = (float(good.min()), float(good.max())) if len(good) else (None, None)
        checks.append(ChannelCheck(channel.name, channel.unit, len(good) / len(column), low, high))
    return checks


def _judge(result: Examination) -> None:
    for name, figures in result.status["streams"].items():
        nominal, rate = figures["nominal_hz"], figures["rate_hz"]
        bound = (result.status["bounds_ms"][name] or 0.0) * 1e-3
        if not figures["samples"] and nominal:
            _failed(result, f"{name}: no samples arrived")
        elif not figures["samples"]:
            _warn(result, f"{name}: no samples arrived; the device sends them on change")
        elif nominal and rate is not None and abs(rate - nominal) > RATE_TOLERANCE * nominal:
            _warn(result, f"{name}: declared {nominal:g} Hz, measured {rate:.1f} Hz")
        if bound > max(CLOCK_TOLERANCE, 0.5 / nominal if nominal else 0.0):
            _warn(
                result,
                f"{name}: its time stamps may be wrong by {bound:.3g} s, too much to compare it with other sources",
            )
    lost = sum(result.status["missed"].values()) + sum(result.status["dropped"].values())
    if lost:
        reasons = ", ".join(
            f"{n} {why}" for outcome in ("missed", "dropped") for why, n in result.status[outcome].items()
        )
        _warn(result, f"{lost} of {result.status['expected']} samples lost: {reasons}")
    dead = [c.name for c in result.channels if c.finite == 0]
    if dead:
        _warn(result, f"no values: {', '.join(dead)}")


def _warn(result: Examination, text: str) -> None:
    result.findings.append(text)
    if result.verdict == "ok":
        result.verdict = "warning"


def _add_events(result: Examination, events: list[Event]) -> None:
    """Add the events of the source during the reading: they explain missing samples."""
    by_kind: dict[str, list[Event]] = {}
    for event in events:
        if event.kind not in ("connected", "reconnected"):
            by_kind.setdefault(event.kind, []).append(event)
    for kind, same in list(by_kind.items())[:MOST_EVENTS]:
        text = same[0].text.removeprefix(f"{result.name}: ")
        more = f" (and {len(same) - 1} more of {kind})" if len(same) > 1 else ""
        if kind in HARMLESS or kind.endswith("_state"):
            result.findings.append(text + more)
        else:
            _warn(result, text + more)
    if len(by_kind) > MOST_EVENTS:
        _warn(result, f"{len(by_kind) - MOST_EVENTS} more kinds of events")
