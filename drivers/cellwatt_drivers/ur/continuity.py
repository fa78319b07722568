"""Finds by the controller's timestamps packages that never came and a time base that changed."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Steps = NDArray[np.int64]
Policy = Literal["auto", "requested", "off"]

WINDOW = 50
"""Steps from which a grid is learned."""
SHARE = 0.9
"""Part of the steps of a window that must be whole multiples of the grid's step."""
OFF_GRID = 0.1
"""Distance of a step from a whole multiple, in steps of the grid …"""
SLACK = 1e-4
"""… and how much further for each step it spans."""
RESOLUTION = 100_000
"""Steps are taken for the same within this, ns; recordings often have milliseconds."""

TOLERANCE = 20_000_000
"""Time bases are told apart beyond this, ns: more than a controller's own delay between stamp and wire."""
DRIFT = 1e-3
"""The two times run apart by less than this; the cell's own may be slewed by half of it."""


class Grid:
    """Counts the packages missing between those that came, from the steps of the controller's time.

    ``requested`` trusts the step that was asked for, ``off`` counts nothing, ``auto`` learns:
    the grid's step is the most common one of ``WINDOW`` steps, believed while ``SHARE`` of the steps are
    whole multiples of it. So a controller that delivers less than asked for, and a recording with uneven
    times, are told apart from one that loses packages.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self.step: float | None = None
        """Step of the grid in force, ns, or ``None``."""
        self._window: list[int] = []
        self._strange = 0
        self._seen = 0

    def ask(self, period: float) -> None:
        """The step asked of the controller is ``period`` ns."""
        if self.policy == "requested":
            self.step = period

    def keeps(self, step: int) -> bool:
        """True if a step of this many ns is one step of the grid in force, so that nothing is missing."""
        return self.step is not None and abs(step - self.step) <= OFF_GRID * self.step

    def missing(self, steps: Steps) -> int:
        """Return how many packages are newly known to be missing, given the next steps (n,) ns, all above 0."""
        if self.policy == "off":
            return 0
        if self.step is None:
            return self._learn(steps)
        if abs(int(steps.max()) - self.step) <= OFF_GRID * self.step and steps.min() >= (1 - OFF_GRID) * self.step:
            self._review(len(steps), 0)
            return 0
        cycles = np.rint(steps / self.step)
        if self.policy == "requested":
            return int(np.maximum(cycles - 1, 0).sum())
        fits = _fit(steps, self.step)
        missing = int((cycles[fits] - 1).sum())
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
        """Give up a grid that steps no longer keep."""
        self._seen += seen
        self._strange += strange
        if self._seen >= WINDOW:
            if self._strange > (1 - SHARE) * self._seen:
                self.step = None
            self._seen = self._strange = 0


def _most_common(steps: Steps) -> float:
    """Mean of the steps that are, within the resolution, the most common one."""
    rounded = np.rint(steps / RESOLUTION).astype(np.int64)
    values, counts = np.unique(rounded, return_counts=True)
    return float(steps[rounded == values[counts.argmax()]].mean())


def _fit(steps: Steps, step: float) -> NDArray[np.bool_]:
    """Mark the steps that are whole multiples, at least one, of ``step``."""
    cycles = steps / step
    nearest = np.rint(cycles)
    fits: NDArray[np.bool_] = (nearest >= 1) & (np.abs(cycles - nearest) <= OFF_GRID + SLACK * nearest)
    return fits


class TimeBase:
    """Notices that the controller's time base moved against the cell's time.

    The offset (cell's time − controller's time) is at most what an arrival shows, since nothing arrives before
    it is made, and at least what an answered question shows, since what follows the answer was made after the
    question. Bounds that contradict each other mean a new base. All times ns.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Start anew."""
        self._upper: float | None = None
        self._lower: float | None = None
        self._upper_at = self._lower_at = 0

    def arrived(self, device: int, now: int) -> bool:
        """A package with this controller time arrived now; false where that cannot be on the known base."""
        offset = now - device
        if self._lower is not None:
            lower = self._lower - DRIFT * (now - self._lower_at)
            if offset < lower - TOLERANCE:
                return False
        if self._upper is None or offset < self._upper + DRIFT * (now - self._upper_at):
            self._upper, self._upper_at = offset, now
        return True

    def made_after(self, device: int, not_before: int) -> bool:
        """A package was made no earlier than the cell's time; false where that cannot be on the known base."""
        offset = not_before - device
        if self._upper is not None:
            upper = self._upper + DRIFT * max(not_before - self._upper_at, 0)
            if offset > upper + TOLERANCE:
                return False
        if self._lower is None or offset > self._lower - DRIFT * (not_before - self._lower_at):
            self._lower, self._lower_at = offset, not_before
        return True
