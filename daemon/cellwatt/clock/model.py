"""The clock model of one stream: device time in, the cell's time and its bound out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float, Nanoseconds
from cellwatt.clock.lines import BLOCK, MAX_DRIFT, SECOND, SPAN, Facts, Lines, claims, possible

_STALL = SPAN * BLOCK
"""Largest delay of the first sample, ns."""
_WANDER = 0.15e-6 / SECOND
"""Fastest change of the drift per ns: 0.1 ppm/s of the device's, and 0.05 ppm/s of the cell's own slew."""
_FRESH = 30 * SECOND
"""Brackets are measured facts: while the newest is no older than this, claims from ``least_delay`` are not used."""
_BACK = "the device's time went back"
_EARLY = "the device's time jumped ahead: a sample would have arrived before it was made"
_LATE = "the device's time fell behind: a sample would have been made before it was requested"
_CONFLICT = "no steady clock fits the arrivals of the last minute: the device's time stepped"


@dataclass(frozen=True, slots=True)
class ClockState:
    """Estimated state of a device's clock.

    ``offset_ns`` is cell time − device time at the newest sample, ``drift_ppm`` the rate of the device's clock
    relative to the cell's (positive is faster), ``bound_ns`` the half width stated for the newest sample, ``age_s``
    the time since the last reset, ``samples`` the total number stamped, ``reason`` that of the last of ``resets``.
    """

    offset_ns: int
    drift_ppm: float
    bound_ns: int
    age_s: float
    resets: int
    samples: int
    reason: str


class ClockModel:
    """Maps the device time of one stream to the cell's time, with a bound on every sample.

    The facts are one-sided: no sample arrives before it was made, and a sample that answers a request
    (``bracket``) was made after the request was sent. Every straight line (offset, drift) that no fact of the last
    64 s contradicts is possible; the time stated is the middle of these lines, the bound reaches the outermost.

    ``least_delay`` (lowest, highest) in s bounds the least transport delay: no sample takes less than the lowest,
    and in 8 s of arrivals at least one takes no more than the highest. Only brackets bound the offset from below
    more tightly.
    """

    def __init__(self, least_delay: tuple[float, float] = (0.0, 0.010)) -> None:
        low, high = least_delay
        if not 0.0 <= low <= high:
            raise ValueError(f"least_delay must be two times in s, the lower one first, not {least_delay}")
        self._least = low * SECOND
        self._leeway = (high - low) * SECOND
        self.resets = 0
        """Number of resets of the map."""
        self._samples = 0
        self._reason = ""
        self._last_time = -(2**62)
        self._start()

    def _start(self) -> None:
        self._zero: tuple[int, int] | None = None  # device time and offset at the origin of the facts
        self._lines = Lines(0, -math.inf, math.inf, -MAX_DRIFT, MAX_DRIFT)
        self._above = Facts(1)
        self._below = Facts(-1)
        self._bracketed = -_FRESH
        self._floor: int | None = None  # the sample after a reset was made no earlier than this
        self._last: int | None = None
        self._first_arrival = self._last_arrival = 0

    def stamp(self, device_time: Nanoseconds, arrival: int) -> tuple[Nanoseconds, Nanoseconds]:
        """The cell's time and its bound, each (n,) ns, of samples made at ``device_time`` (n,) and read at ``arrival``.

        Times rise strictly over all calls; if a better estimate would turn them back, they continue at half pace and
        the bound covers the difference. A step of the device's clock resets the map (see ``resets`` and ``state``).
        """
        if len(device_time) == 0:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        self._samples += len(device_time)
        steps = self._steps(device_time, arrival)
        if not steps:
            return self._stamp(device_time, arrival)
        done = []
        starts = [k for k, _ in steps]
        if starts[0] > 0:
            done.append(self._stamp(device_time[: starts[0]], arrival))
        for (start, reason), end in zip(steps, [*starts[1:], len(device_time)], strict=True):
            if reason is _BACK or self._last_arrival - self._bracketed < _FRESH:
                self.reset(reason)
            else:
                self._restart(reason)  # the device's clock may be right, the claim wrong
            done.append(self._stamp(device_time[start:end], arrival))
        return np.concatenate([time for time, _ in done]), np.concatenate([bound for _, bound in done])

    def bracket(self, device_time: int, not_before: int) -> None:
        """Note that the sample with ``device_time`` was made no earlier than the cell's time ``not_before``, ns."""
        if self._zero is None:
            self._zero = (device_time, not_before - device_time)
        at, offset = device_time - self._zero[0], float(not_before - device_time - self._zero[1])
        there = self._lines.moved(at, _WANDER)
        if offset > there.upper:
            self._restart(_LATE)
            self.bracket(device_time, not_before)
            return
        self._below.add(not_before, (at, offset), there.slope)
        self._bracketed = not_before
        if offset > there.lower:
            self._lines = there._replace(lower=offset)

    def reset(self, reason: str) -> None:
        """Discard the map: the device's time has a new base. Samples still arrive in the order they were made."""
        floor = self._floor
        self._restart(reason)
        self._floor = floor

    def _restart(self, reason: str) -> None:
        self.resets += 1
        self._reason = reason
        self._start()

    def state(self) -> ClockState:
        """Present estimate."""
        offset, bound = (0, 0) if self._last is None or self._zero is None else self._estimate(self._zero[1])
        return ClockState(
            offset_ns=offset,
            drift_ppm=-self._lines.slope * 1e6,
            bound_ns=bound,
            age_s=(self._last_arrival - self._first_arrival) / SECOND,
            resets=self.resets,
            samples=self._samples,
            reason=self._reason,
        )

    def _steps(self, device_time: Nanoseconds, arrival: int) -> list[tuple[int, str]]:
        """Steps of the device's clock within a block: index and reason."""
        first, last = int(device_time[0]), int(device_time[-1])
        steps = [(0, _BACK)] if self._last is not None and first <= self._last else []
        gaps = device_time[1:] - device_time[:-1] if len(device_time) > 1 else None
        if gaps is not None and gaps.min() <= 0:
            steps += [(int(k) + 1, _BACK) for k in np.flatnonzero(gaps <= 0)]
        if steps or self._zero is None or self._last is None:
            return steps
        offset = arrival - last - self._zero[1] - self._least
        if offset >= self._lines.moved(last - self._zero[0], _WANDER).lower:
            return []
        inside = gaps is not None and int(gaps.max()) > first - self._last
        return [(int(gaps.argmax()) + 1 if inside and gaps is not None else 0, _EARLY)]

    def _stamp(self, device_time: Nanoseconds, arrival: int) -> tuple[Nanoseconds, Nanoseconds]:
        last = int(device_time[-1])
        offset, half = self._learn(last, arrival)
        if len(device_time) == 1:
            time, bound = np.array([last + offset]), np.array([half])
        else:
            before = (device_time - last).astype(np.float64)
            lines = self._lines
            time = device_time + offset + (before * lines.slope).astype(np.int64)
            bound = half - (before * ((lines.fast - lines.slow) / 2)).astype(np.int64)
        time, bound = self._rising(device_time, time, bound, arrival)
        self._last, self._last_time = last, int(time[-1])
        self._floor = self._last_time - int(bound[-1])
        return time, bound

    def _learn(self, last: int, arrival: int) -> tuple[int, int]:
        """Learn from the arrival of the newest sample; return offset and half width at that sample, ns."""
        zero = self._zero
        if zero is None:
            zero = self._zero = (last, arrival - last)
        at, offset = last - zero[0], arrival - last - zero[1] - self._least
        at_, lower, upper, slow, fast = self._lines.moved(at, _WANDER)
        if self._last is None:
            lower = max(lower, self._begin(at, offset, arrival))
        if offset < lower:
            self._restart(_EARLY)
            return self._learn(last, arrival)
        self._last_arrival = arrival
        self._lines = Lines(at_, lower, min(upper, offset), slow, fast)
        if self._above.add(arrival, (at, offset), (slow + fast) / 2):
            lines = possible(self._above.all(), self._from_below(arrival), _WANDER)
            if lines is None:
                self._restart(_CONFLICT)
                return self._learn(last, arrival)
            lines = lines.moved(at, _WANDER)
            self._lines = lines._replace(upper=min(lines.upper, offset))
        return self._estimate(zero[1])

    def _begin(self, at: int, offset: float, arrival: int) -> float:
        """Facts from below that the first sample of a map gives: no stall was longer, and samples come in order."""
        self._first_arrival = arrival
        lower = offset - self._leeway - _STALL
        if self._floor is not None:
            in_order = offset + self._least - (arrival - self._floor)
            self._below.add(arrival, (at, in_order), 0.0)
            lower = max(lower, in_order)
        return lower

    def _from_below(self, arrival: int) -> Float:
        """Facts from below: the brackets, and the claims of ``least_delay`` while the brackets are not fresh."""
        brackets = self._below.all()
        if arrival - self._bracketed < _FRESH:
            return brackets
        blocks = self._above.closed()
        waived = 0 if len(blocks) >= SPAN else max(0, _STALL - (arrival - self._first_arrival))
        claimed = claims(blocks, self._leeway + waived, self._lines, _WANDER)
        return np.concatenate([brackets, claimed])

    def _estimate(self, zero: int) -> tuple[int, int]:
        """Offset and half width at the newest sample, ns: middle, or near the upper edge if the lower is a guess."""
        lower, upper = self._lines.lower, self._lines.upper
        offset = max((lower + upper) / 2, upper - self._leeway)
        return zero + round(offset), math.ceil(max(upper - offset, offset - lower)) + 2

    def _rising(
        self, device_time: Nanoseconds, time: Nanoseconds, bound: Nanoseconds, arrival: int
    ) -> tuple[Nanoseconds, Nanoseconds]:
        """Times that rise from the last one by at least half the device's pace, but not past the arrival."""
        floor = self._last_time + 1
        if self._last is not None:
            floor = max(floor, min(floor + (int(device_time[0]) - self._last) // 2, arrival))
        if int(time[0]) >= floor and (len(time) == 1 or int((time[1:] - time[:-1]).min()) > 0):
            return time, bound
        since = (device_time - device_time[0]).astype(np.float64)
        rate = min(0.5, max(0, arrival - floor) / max(since[-1], 1.0))
        pace = (since * rate).astype(np.int64) + np.arange(floor, floor + len(time))
        raised = np.maximum(np.maximum.accumulate(time - pace), 0) + pace
        return raised, bound + (raised - time)
