"""Looks at one source for a while and says what works: the maths and I/O behind ``cellwatt doctor``."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from cellwatt.batch import Batch
from cellwatt.cell_clock import CellClock
from cellwatt.config import SourceConfig
from cellwatt.driver import Driver
from cellwatt.errors import SourceError
from cellwatt.registry import driver as find_driver
from cellwatt.results import Event
from cellwatt.runtime.source import Source

log = logging.getLogger(__name__)

RATE_TOLERANCE = 0.02
"""A measured rate this close to the declared one is as declared."""


@dataclass
class ChannelCheck:
    """What one channel gave: finite share of samples, range, unit."""

    name: str
    unit: str
    finite: float
    low: float | None
    high: float | None


@dataclass
class Examination:
    """What ``doctor`` found about one source. ``verdict`` is ``ok``, ``warning`` or ``failed``."""

    name: str
    driver: str
    verdict: str
    findings: list[str] = field(default_factory=list)
    status: dict[str, Any] = field(default_factory=dict)
    channels: list[ChannelCheck] = field(default_factory=list)


async def examine(config: SourceConfig, seconds: float, patience: float, batches: list[Batch]) -> Examination:
    """Ask a device who it is, read it for ``seconds``, and judge. Opens it read-only.

    ``patience`` s is how long it may take to answer. What was read is appended to ``batches``, which must be empty.
    """
    clock = CellClock()
    events: list[Event] = []
    driver_class = find_driver(config.driver)

    def make(outlet: Source) -> Driver[Any]:
        return driver_class(config.name, config.settings, outlet)

    source = Source(config.name, make, clock.now, batches.append, events.append)
    result = Examination(config.name, config.driver, "ok")
    try:
        async with asyncio.timeout(patience):
            result.status["identity"] = asdict(await source.driver.identify())
    except TimeoutError:
        return _failed(result, f"no answer within {patience:.0f} s")
    except SourceError as error:
        return _failed(result, str(error))
    except Exception as error:
        log.exception("%s: the %s driver broke", config.name, config.driver)
        return _failed(result, f"the {config.driver} driver broke: {type(error).__name__}: {error}")
    reading = asyncio.create_task(source.driver.run())
    try:
        done, _ = await asyncio.wait({reading}, timeout=seconds)
        if done:
            failure = None if reading.cancelled() else reading.exception()
            _failed(result, f"reading stopped: {failure or 'the driver ended though nobody stopped it'}")
    finally:
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
    identity = result.status["identity"]
    result.status = source.status() | {"identity": identity, "events": [e.text for e in events]}
    result.channels = [check for s in source.driver.streams for check in _channels(s.name, batches)]
    _judge(result)
    return result


def _failed(result: Examination, text: str) -> Examination:
    result.verdict = "failed"
    result.findings.append(text)
    return result


def _channels(stream: str, batches: list[Batch]) -> list[ChannelCheck]:
    mine = [b for b in batches if b.stream.name == stream]
    if not mine:
        return []
    values = np.concatenate([b.values for b in mine])
    checks = []
    for channel, column in zip(mine[0].stream.channels, values.T, strict=True):
        good = column[np.isfinite(column)]
        low, high = (float(good.min()), float(good.max())) if len(good) else (None, None)
        checks.append(ChannelCheck(channel.name, channel.unit, len(good) / len(column), low, high))
    return checks


def _judge(result: Examination) -> None:
    for name, figures in result.status["streams"].items():
        nominal, rate = figures["nominal_hz"], figures["rate_hz"]
        if not figures["samples"]:
            result.findings.append(f"{name}: no samples came")
            result.verdict = "failed"
        elif nominal and rate is not None and abs(rate - nominal) > RATE_TOLERANCE * nominal:
            result.findings.append(f"{name}: declared {nominal:g} Hz, measured {rate:.1f} Hz")
            result.verdict = "warning" if result.verdict == "ok" else result.verdict
    lost = sum(result.status["missed"].values()) + sum(result.status["dropped"].values())
    if lost:
        reasons = ", ".join(f"{n} {why}" for part in ("missed", "dropped") for why, n in result.status[part].items())
        result.findings.append(f"{lost} of {result.status['expected']} samples lost: {reasons}")
        result.verdict = "warning" if result.verdict == "ok" else result.verdict
    dead = [c.name for c in result.channels if c.finite == 0]
    if dead:
        result.findings.append(f"never a number: {', '.join(dead)}")
        result.verdict = "warning" if result.verdict == "ok" else result.verdict
