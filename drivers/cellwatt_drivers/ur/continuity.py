"""Finds missing packages and changes of the time base from the controller's timestamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Steps = NDArray[np.int64]

WINDOW = 50
"""Number of steps from which a grid is learned."""
SHARE = 0.9
"""Share of the steps of a window that must be whole multiples of the grid's step."""
OFF_GRID = 0.1
"""Largest distance of a step from a whole multiple, in steps of the grid …"""
SLACK = 1e-4
"""… and the further distance allowed per grid step that it spans."""
RESOLUTION = 100_000
"""Steps that differ by less are equal, ns; recordings often have a resolution of milliseconds."""

TOLERANCE = 20_000_000
"""Contradiction of the bounds, ns, that proves a new time base; more than a controller's delay from stamp to wire."""
DRIFT = 1e-3
"""Largest rate difference of the two clocks; the cell's clock alone may be slewed by half of it."""


class Grid:
    """Counts the packages missing between received ones, from the steps of the controller's time.

    The grid's step is the most common one of ``WINDOW`` steps, and is valid while ``SHARE`` of the steps are whole
    multiples of it. This distinguishes a controller that delivers less than requested, and a recording with uneven
    times, from a controller that loses packages.
    """

    def __init__(self) -> None:
        self.step: float | None = None
        """Step of the grid in force, ns, or ``None``."""
        self._window: list[int] = []
        self._strange = 0
        self._seen = 0

    def keeps(self, step: int) -> bool:
        """True if a step of this many ns is one step of the grid in force, so that no package is missing."""
        return self.step is not None and abs(step - self.step) <= OFF_GRID * self.step

    def missing(self, steps: Steps) -> int:
        """Return how many packages are newly known to be missing, given the next steps (n,) ns, all above 0."""
        if self.step is None:
            return self._learn(steps)
        if abs(int(steps.max()) - self.step) <= OFF_GRID * self.step and steps.min() >= (1 - OFF_GRID) * self.step:
            self._review(len(steps), 0)
            return 0
        fits = _fit(steps, self.step)
        missing = int((np.rint(steps[fits] / self.step) - 1).sum())
        self._review(len(steps), len(steps) - int(np.count_nonzero(fits)))
        return missing

    def _learn(self, steps: Steps) -> int:
        self._window.extend(steps.tolist())
        if len(self._window) < WINDOW:
            return 0
        window = np.array(self._window, dtype=np.int64)
        self._window.clear()
        step = _most_common(window)
        fits = _fit(window, step)
        if np.count_nonzero(fits) < SHARE * len(window):
            return 0
        self.step = step
        return int((np.rint(window[fits] / step) - 1).sum())

    def _review(self, seen: int, strange: int) -> None:
        """Discard a grid that the steps no longer fit."""
        self._seen += seen
        self._strange += strange
        if self._seen >= WINDOW:
            if self._strange > (1 - SHARE) * self._seen:
                self.step = None
            self._seen = self._strange = 0


def _most_common(steps: Steps) -> float:
    """Mean of the most common step, within the resolution."""
    rounded = np.rint(steps / RESOLUTION).astype(np.int64)
    values, counts = np.unique(rounded, return_counts=True)
    return float(steps[rounded == values[counts.argmax()]].mean())


def _fit(steps: Steps, step: float) -> NDArray[np.bool_]:
    """Mark the steps that are whole multiples of ``step``, at least one of it."""
    cycles = steps / step
    nearest = np.rint(cycles)
    fits: NDArray[np.bool_] = (nearest >= 1) & (np.abs(cycles - nearest) <= OFF_GRID + SLACK * nearest)
    return fits


class TimeBase:
    """Detects that the controller's time base moved against the cell's time.

    The offset (cell's time − controller's time) is at most that of an arrival, because a package arrives after it is
    made, and at least that of an answered request, because packages after the answer were made after the request.
    Bounds that contradict each other mean a new base. All times in ns.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Discard both bounds."""
        self._upper: float | None = None
        self._lower: float | None = None
        self._upper_at = self._lower_at = 0

    def arrived(self, device: int, now: int) -> bool:
        """Add a package that arrived now with this controller time; false if it contradicts the known base."""
        offset = now - device
        if self._lower is not None:
            lower = self._lower - DRIFT * (now - self._lower_at)
            if offset < lower - TOLERANCE:
                return False
        if self._upper is None or offset < self._upper + DRIFT * (now - self._upper_at):
            self._upper, self._upper_at = offset, now
        return True

    def made_after(self, device: int, not_before: int) -> bool:
        """Add a package made no earlier than ``not_before``, cell's time; false if it contradicts the known base."""
        offset = not_before - device
        if self._upper is not None:
            upper = self._upper + DRIFT * max(not_before - self._upper_at, 0)
            if offset > upper + TOLERANCE:
                return False
        if self._lower is None or offset > self._lower - DRIFT * (not_before - self._lower_at):
            self._lower, self._lower_at = offset, not_before
        return True
