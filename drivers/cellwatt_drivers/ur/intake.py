"""From decoded packages to the daemon: losses, time base, states of the robot."""

from __future__ import annotations

import time as clock
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cellwatt.account import Losses
from cellwatt.arrays import Float
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Identity, Inlet
from cellwatt.errors import ProtocolError
from cellwatt_drivers.shared.states import State, StateWatch
from cellwatt_drivers.ur.continuity import Grid, TimeBase
from cellwatt_drivers.ur.fields import ROBOT_MODES, RUNTIME_STATES, SAFETY_MODES
from cellwatt_drivers.ur.wire import TextMessage

LATEST = 9e9
"""Controller times from this on, s, are garbage (and do not fit 64 bits of ns)."""
QUIET = 0.25
"""Shortest time without a package, s, after which a stream is reported as stopped."""

_STATES = {
    "robot.mode": State("robot mode", "robot mode", ROBOT_MODES),
    "robot.safety_mode": State("safety mode", "safety mode", SAFETY_MODES),
    "robot.runtime_state": State("program", "program", RUNTIME_STATES),
}
_LEVELS = ("exception", "error", "warning", "info")


def refuse_strange(time: Float) -> None:
    """Raise ``ProtocolError`` if one of the controller times (n,) s is impossible."""
    if not (time.min() >= 0 and time.max() < LATEST):
        raise ProtocolError(f"controller time {time.min():g} … {time.max():g} s is not a time since its start")


class Intake:
    """Takes the packages of one robot in order, over all its connections, and counts them in the account.

    ``expect`` follows the controller's timestamps: one package for each step of the grid, or one for each received
    package if there is no grid. A package that repeats the previous timestamp is dropped.
    """

    def __init__(self, inlet: Inlet, stream: Stream) -> None:
        self._inlet = inlet
        self._stream = stream
        self._rate = stream.rate
        self._cycle = 0  # of the controller's loop, ns
        self._grid = Grid()
        self._base = TimeBase()
        self._last: int | None = None  # controller time of the last package, ns
        self._losses = Losses(inlet.account)
        self._identity: Identity | None = None
        self._last_arrival = 0.0  # monotonic, s
        self._quiet = False
        self._states = StateWatch(inlet, stream, _STATES)
        self.resets = 0
        """Number of new time bases of the controller."""

    def opened(self, identity: Identity, loop: float, rate: float) -> None:
        """Begin a connection to a controller that runs at ``loop`` Hz and sends at ``rate`` Hz.

        The daemon is notified of the connection with its first package.
        """
        self._identity = identity
        self._cycle = round(1e9 / loop)
        self._rate = rate
        self._losses.resumed = True
        self._last_arrival = clock.monotonic()
        self._quiet = False

    def take(self, time: Float, values: Float, not_before: int | None = None, arrival: int | None = None) -> None:
        """Take the next packages: controller time (n,) s and values (n, channels).

        ``not_before``: cell's time, ns, at which the first package was requested; it was made after that, within one
        cycle of the controller. ``arrival``: cell's time, ns, of the last package; default: now. Raises
        ``ProtocolError`` if a controller time is impossible.
        """
        arrival = self._inlet.now() if arrival is None else arrival
        if len(time) == 1 and not_before is None and self._next(time.item(), values, arrival):
            return
        refuse_strange(time)
        device = np.rint(time * 1e9).astype(np.int64)
        self._speak()
        if not_before is not None:
            if self._last is not None and device[0] < self._last:
                self._reset(int(device[0]))
            self._bracket(int(device[0]), not_before - self._cycle)
        # The first package of a time base has no step; 1 stands for any time before it.
        steps = np.empty_like(device)
        steps[0] = 1 if self._last is None else device[0] - self._last
        np.subtract(device[1:], device[:-1], out=steps[1:])
        if steps.min() > 0 and self._base.arrived(int(device[-1]), arrival):
            self._emit(device, values, steps, arrival)
        else:
            self._untangle(device, values, steps, arrival)

    def _next(self, time: float, values: Float, arrival: int) -> bool:
        """Take one package that is one step after the last: the usual case, without the cost of arrays."""
        if self._last is None or self._losses.resumed or not 0 <= time < LATEST:
            return False
        device = round(time * 1e9)
        if not self._grid.keeps(device - self._last) or not self._base.arrived(device, arrival):
            return False
        self._speak()
        self._inlet.account.expect()
        self._deliver(np.array([device]), values, arrival)
        return True

    def compared(self, device: int, not_before: int) -> None:
        """Take the controller time ``device`` (ns) from another connection; ``not_before`` as in ``take``."""
        if self._last is not None:
            self._bracket(device, not_before - self._cycle)

    def message(self, message: TextMessage) -> None:
        """Report a text message of the controller."""
        level = _LEVELS[message.level] if message.level < len(_LEVELS) else str(message.level)
        text = f"controller {level} from {message.source or 'itself'}: {message.text}"
        self._inlet.event("message", text, level=level, source=message.source)

    def watch(self, timeout: float) -> bool:
        """Report a stream that stopped; true if no package has arrived for ``timeout`` s."""
        silence = clock.monotonic() - self._last_arrival
        if not self._quiet and silence > max(QUIET, 10 / self._rate):
            self._quiet = True
            self._inlet.event("stream stopped", f"no package for {silence:.2f} s, still connected", seconds=silence)
        return silence > timeout

    def _speak(self) -> None:
        """Report a new connection or a resumed stream when a package arrives."""
        if self._identity is not None:
            self._inlet.connected(self._identity)
            self._identity = None
        now = clock.monotonic()
        if self._quiet:
            self._quiet = False
            silence = now - self._last_arrival
            self._inlet.event("stream resumed", f"packages again after {silence:.2f} s", seconds=silence)
        self._last_arrival = now

    def _bracket(self, device: int, not_before: int) -> None:
        if not self._base.made_after(device, not_before):
            self._reset(device)
            self._base.made_after(device, not_before)
        self._inlet.bracket(self._stream, device, not_before)

    def _untangle(self, device: NDArray[np.int64], values: Float, steps: NDArray[np.int64], arrival: int) -> None:
        """Take a block in which the time repeats, goes back, or jumps ahead of the arrival."""
        fresh = steps != 0
        repeated = len(steps) - int(np.count_nonzero(fresh))
        self._inlet.account.expect(repeated)
        self._inlet.account.drop(repeated, "repeated timestamp")
        device, values, steps = device[fresh], values[fresh], steps[fresh]
        if not len(device):
            return
        cuts = steps < 0
        if not cuts.any():
            if self._base.arrived(int(device[-1]), arrival):
                self._emit(device, values, steps, arrival)
                return
            cuts[int(steps.argmax())] = True
        edges = sorted({0, *np.flatnonzero(cuts).tolist(), len(device)})
        for start, end in pairwise(edges):
            if cuts[start]:
                self._reset(int(device[start]))
            self._base.arrived(int(device[end - 1]), arrival)
            self._emit(device[start:end], values[start:end], steps[start:end], arrival)

    def _reset(self, device: int) -> None:
        """Report a new time base; losses between the two bases are unknown."""
        before = "" if self._last is None else f" from {self._last / 1e9:.3f} s"
        reason = f"controller time jumped{before} to {device / 1e9:.3f} s: it restarted or its clock was set"
        self.resets += 1
        self._base.forget()
        self._last = None
        self._losses.resumed = False
        self._inlet.clock_reset(self._stream, reason)

    def _emit(self, device: NDArray[np.int64], values: Float, steps: NDArray[np.int64], arrival: int) -> None:
        steps = steps[1:] if self._last is None else steps
        if len(steps):
            self._count(steps)
        self._inlet.account.expect(len(device))
        self._deliver(device, values, arrival)

    def _deliver(self, device: NDArray[np.int64], values: Float, arrival: int) -> None:
        self._last = int(device[-1])
        self._inlet.emit(Reading(self._stream, values, arrival, device))
        self._states.see(values)

    def _count(self, steps: NDArray[np.int64]) -> None:
        """Count losses before and between the packages; the first step after a reconnection belongs to the outage."""
        before = self._grid.step
        if self._losses.resumed:
            self._losses.before_next(self._grid.missing(steps[:1]))
            steps = steps[1:]
        if len(steps):
            self._losses.before_next(self._grid.missing(steps))
        if self._grid.step != before:
            self._report_grid()

    def _report_grid(self) -> None:
        """Report packages that are not on the requested grid."""
        step = self._grid.step
        if step is None:
            self._inlet.event("uneven timestamps", "packages no longer fit a grid: losses cannot be counted")
        elif abs(step * self._rate / 1e9 - 1) > 0.02:
            text = f"asked for {self._rate:g} Hz, packages are made at {1e9 / step:g} Hz"
            self._inlet.event("rate", text, rate=1e9 / step)
