"""One source at run time: its driver supervised, its samples counted, stamped and numbered."""

from __future__ import annotations

import asyncio
import logging
import random
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwatt.account import Account
from cellwatt.batch import Batch, Reading
from cellwatt.channel import Quality, Stream
from cellwatt.clock import ClockModel, middle
from cellwatt.driver import Driver, Identity
from cellwatt.errors import SourceError, WrongDeviceError
from cellwatt.results import Event
from cellwatt.runtime.allowance import MULTIPLE, ONCE, Allowance, Repeats, one_line
from cellwatt.runtime.tasks import end_of

log = logging.getLogger(__name__)

FIRST_PAUSE, LONGEST_PAUSE, WRONG_DEVICE_PAUSE = 0.5, 10.0, 10.0  # s
STEADY = 5.0
"""A connection that lasted this long, s, resets the back-off."""
BLANK, LEAST_SAMPLES = 60.0, 3
"""Time in s, and smallest number of samples, without a value after which a channel counts as blank."""
NEVER = -(2**62)
"""Less than the number of any sample."""


def next_pause(pause: float, error: BaseException, jitter: float) -> float:
    """Seconds to wait before the next try: doubled each time, capped, spread by ``jitter`` in 0 … 1."""
    longer = WRONG_DEVICE_PAUSE if isinstance(error, WrongDeviceError) else min(2 * pause, LONGEST_PAUSE)
    return longer * (0.8 + 0.4 * jitter)


def _first(reading: Reading, n: int) -> Reading:
    arrays = [name for name in ("values", "device_time", "quality") if getattr(reading, name) is not None]
    return replace(reading, **{name: getattr(reading, name)[:n] for name in arrays})


class Source:
    """The daemon's side of one driver, which is created with its ``settings``; implements ``cellwatt.driver.Inlet``.

    ``take`` is called with every batch and ``tell`` with every event, on the event loop. ``now`` is the cell's clock.
    ``sequence`` continues the numbering of a source of the same name that a reload replaced. ``crowded`` returns
    whether streams are limited to their declared rates.
    """

    def __init__(
        self,
        name: str,
        driver: Callable[[str, Any, Source], Driver[Any]],
        settings: Any,
        now: Callable[[], int],
        take: Callable[[Batch], None],
        tell: Callable[[Event], None],
        sequence: Mapping[str, int] | None = None,
        crowded: Callable[[], bool] = lambda: False,
    ) -> None:
        self.name = name
        self.account = Account()
        self.now = now
        self._take = take
        self._tell = tell
        self.state = "starting"
        self.identity: Identity | None = None
        self.last_error: str | None = None
        self.since = time.monotonic()
        self._connected_at: float | None = None
        self.driver = driver(name, settings, self)
        self.meters = {s.name: RateMeter() for s in self.driver.streams}
        self.clocks: dict[str, ClockModel] = {
            s.name: ClockModel(least_delay=self.driver.least_delay) for s in self.driver.streams if s.clock == "device"
        }
        self.sequence = dict.fromkeys(self.meters, 0) | dict(sequence or {})
        """Number of the next sample, by stream."""
        self._last_time = dict.fromkeys(self.meters, 0)
        self._allowances = {s.name: Allowance(s.rate, now, crowded) for s in self.driver.streams}
        self._repeats = Repeats()
        self._valued = {s.name: np.full(len(s.channels), NEVER) for s in self.driver.streams}
        """Number of the sample after the last one with a value since the connection, of each channel, by stream."""

    # Inlet ---------------------------------------------------------------------------------------

    def connected(self, identity: Identity) -> None:
        """See ``Inlet.connected``."""
        again = self.state == "retrying"
        self.identity = identity
        self._connected_at = time.monotonic()
        self.last_error = None
        if self.state != "ok":
            for valued in self._valued.values():
                valued[:] = NEVER
            self.state, self.since = "starting", time.monotonic()
        who = " ".join(x for x in (identity.maker, identity.model, identity.firmware) if x)
        self.event("reconnected" if again else "connected", f"{self.name}: {who} answers")

    def emit(self, reading: Reading) -> None:
        """See ``Inlet.emit``."""
        n = len(reading.values)
        if n == 0:
            return
        stream = reading.stream
        allowed = self._allowances[stream.name].take(n)
        if allowed < n:
            self._refuse(stream, n - allowed)
            if not allowed:
                return
            reading, n = _first(reading, allowed), allowed
        device_time = reading.device_time
        if device_time is not None:
            clock = self.clocks[stream.name]
            resets = clock.resets
            stamped, bound = clock.stamp(device_time, reading.arrival)
            if clock.resets != resets:
                self.event("clock_step", f"{self.name}: the device's clock stepped ({clock.state().reason})")
        else:
            asked = reading.arrival if reading.asked is None else reading.asked
            stamped, bound = middle(asked, reading.arrival, n, self._last_time[stream.name])
        quality, values = np.zeros(n, np.uint8) if reading.quality is None else reading.quality, reading.values
        valued: slice | np.bool_ | NDArray[np.bool_] = slice(None)
        if not (finite := np.isfinite(values)).all():
            self.account.anomaly("infinite values", int(np.isinf(values).sum()))
            values, valued = np.where(finite, values, np.nan), finite.any(axis=0)
            if reading.quality is None:
                quality = np.where(finite.any(axis=1), quality, Quality.MISSING).astype(np.uint8)
        sequence = self.sequence[stream.name]
        self._valued[stream.name][valued] = self.sequence[stream.name] = sequence + n
        self._last_time[stream.name] = int(stamped[-1])
        self.account.receive(n)
        self.meters[stream.name].add(stamped)
        if self.state == "starting" and finite.any():
            self._enter("ok")
        self._take(Batch(self.name, stream, sequence, reading.arrival, stamped, bound, values, quality, device_time))

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        """See ``Inlet.bracket``."""
        self.clocks[stream.name].bracket(device_time, not_before)

    def clock_reset(self, stream: Stream, reason: str) -> None:
        """See ``Inlet.clock_reset``."""
        self.clocks[stream.name].reset(reason)
        self.event("clock_reset", f"{self.name}: the device's clock changed ({reason})")

    def event(self, kind: str, text: str, **data: str | float) -> None:
        """See ``Inlet.event``."""
        self.account.count(f"event {kind}")
        now = self.now()
        if self._repeats.tell(kind, now):
            self._report(now, kind, text, data)
        elif kind not in ONCE:
            self.account.anomaly("events held back")

    def settle(self) -> None:
        """Report events held back in past minutes; call once a second."""
        now = self.now()
        for kind, n in self._repeats.over(now):
            self._report(
                now, kind, f"{self.name}: {n} more events {kind!r} within a minute were counted, not reported", {}
            )

    def _report(self, now: int, kind: str, text: str, data: Mapping[str, str | float]) -> None:
        text = one_line(text)
        log.info("%s", text)
        self._tell(Event(now, self.name, kind, text, data))

    def _refuse(self, stream: Stream, n: int) -> None:
        """Count ``n`` samples dropped because the stream exceeds its allowed rate."""
        self.account.drop(n, "beyond its rate")
        self.event(
            "beyond_rate",
            f"{self.name}: {stream.name} delivers more than {MULTIPLE:g} times its declared {stream.rate:g} Hz, or "
            "more than declared while this PC is too busy: further samples are dropped; check the setting rate",
        )

    def _blank(self, stream: Stream) -> list[str]:
        """Channels of a connected device without a value in its last samples, except states and those left out.

        Channels of a stream that is sent on change are blank only until their first value.
        """
        if self._connected_at is None:
            return []
        rate = self.driver.rates.get(stream.name, stream.rate)
        since = self.sequence[stream.name] - max(LEAST_SAMPLES, BLANK * rate) if stream.rate else 0
        known = zip(stream.channels, self._valued[stream.name] <= since, strict=True)
        return [c.name for c, b in known if b and c.kind != "discrete" and c.name not in self.driver.left_out]

    # supervision ----------------------------------------------------------------------------------

    async def run(self) -> None:
        """Run the driver until cancelled; restart it after each failure."""
        pause = FIRST_PAUSE / 2
        while True:
            self._connected_at = None
            error = await self._once()
            if self._connected_at is not None and time.monotonic() - self._connected_at > STEADY:
                pause = FIRST_PAUSE / 2
            pause = next_pause(pause, error, random.random())
            self._fail(error, pause)
            await asyncio.sleep(pause)

    async def _once(self) -> Exception | asyncio.CancelledError:
        broke = f"{self.name}: the {type(self.driver).__name__} driver failed"
        error = await end_of(self.driver.run, SourceError, broke)
        if error is None:
            return SourceError(f"{self.name}: the driver ended without being stopped")
        if not isinstance(error, SourceError):
            self.account.count("driver bugs")
        return error

    def _fail(self, error: BaseException, pause: float) -> None:
        self.account.count("restarts")
        text = one_line(str(error) or type(error).__name__)
        if text != self.last_error or self.state != "retrying":
            self.last_error = text
            self.event("lost", f"{self.name}: {text}; trying again in {pause:.1f} s")
        self._enter("retrying")

    def _enter(self, state: str) -> None:
        if state != self.state:
            self.state, self.since = state, time.monotonic()

    def status(self) -> dict[str, Any]:
        """Figures for health, JSON-ready."""
        return {
            "state": self.state,
            "since_s": round(time.monotonic() - self.since, 1),
            "error": self.last_error,
            "identity": asdict(self.identity) if self.identity else None,
            **self.account.snapshot(),
            "streams": {
                s.name: self.meters[s.name].figures(self.driver.rates.get(s.name, s.rate)) | {"blank": self._blank(s)}
                for s in self.driver.streams
            },
            "clocks": {name: asdict(clock.state()) for name, clock in self.clocks.items()},
            "last_sequence": {name: n - 1 for name, n in self.sequence.items()},
        }


WINDOW = 4096
"""Number of samples that a rate is measured over: 8 s at 500 Hz."""


class RateMeter:
    """Rate and jitter over the last samples."""

    def __init__(self) -> None:
        self.samples = 0
        self._times: list[NDArray[np.int64]] = []
        self._count = 0

    def add(self, times: NDArray[np.int64]) -> None:
        """Note samples at times (n,) ns."""
        self.samples += len(times)
        self._times.append(times)
        self._count += len(times)
        if self._count > 2 * WINDOW:
            self._trim()

    def _trim(self) -> None:
        joined = np.concatenate(self._times)[-WINDOW:] if self._times else np.empty(0, np.int64)
        self._times, self._count = [joined], len(joined)

    def figures(self, nominal: float) -> dict[str, Any]:
        """Nominal and measured rate in Hz, jitter (p50, p99 of the deviation from the nominal period) in ms.

        ``nominal`` is 0 if the source sends on change.
        """
        self._trim()
        times = self._times[0]
        out: dict[str, Any] = {"nominal_hz": nominal, "samples": self.samples}
        if len(times) < 3:
            return out | {"rate_hz": None, "jitter_p50_ms": None, "jitter_p99_ms": None, "last": None}
        steps = np.diff(times) * 1e-6
        period = 1e3 / nominal if nominal else float(np.median(steps))
        p50, p99 = np.percentile(np.abs(steps - period), [50, 99])
        rate = (len(times) - 1) / ((times[-1] - times[0]) * 1e-9)
        return out | {
            "rate_hz": round(float(rate), 3),
            "jitter_p50_ms": round(float(p50), 3),
            "jitter_p99_ms": round(float(p99), 3),
            "last": int(times[-1]),
        }
