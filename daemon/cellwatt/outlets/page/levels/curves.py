"""Curves of a cell's record for a browser, and the thread that keeps level files of it up to date."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import CellwattError, RecordingError, why
from cellwatt.outlets.page.levels.buckets import STEPS, Canvas, Grid, chosen, fitting, span_of
from cellwatt.outlets.page.levels.following import Source
from cellwatt.outlets.page.levels.moments import Moments, Samples, read
from cellwatt.outlets.page.levels.store import Store, near
from cellwatt.outlets.page.levels.telling import marks
from cellwatt.outlets.page.shapes import significant
from cellwatt.record.folder import RecordFile

PATIENCE: Final = 5.0
"""s after which an answer is given as far as it goes."""
MOMENTS: Final = 60 * 10**9
"""Longest span, ns, that is answered from the frames themselves, …"""
FINER: Final = STEPS[0] // 2
"""… where the step asked for is shorter than this, ns."""
BESIDE: Final = 10**9
"""ns, more than the step of most frames."""
EXACT: Final = 9
"""Significant digits that tell a single-precision number from all others."""

Float = NDArray[np.float64]


Memory = tuple[int, Mapping[str, Samples]]
"""Step of frames, ns, and samples by channel."""


@dataclass(frozen=True, slots=True)
class _Asked:
    """A question, with the recordings that are there; times UTC ns, ``until`` monotonic s."""

    recordings: Sequence[RecordFile]
    names: list[str]
    start: int
    end: int
    points: int
    until: float
    memory: Memory


class Curves:
    """Answers about the recordings of ``cell`` in ``folder``, which it only reads; without one from memory alone.

    Level files stand in ``levels``, of the newest recordings as far as ``most`` bytes go.
    """

    def __init__(self, folder: Path | None, cell: str, most: float = math.inf) -> None:
        self._recorded = folder is not None
        self.store = Store(folder or Path(), cell, most)
        self._keeper = Keeper(self.store)

    def start(self) -> None:
        """Begin to keep level files up to date, in a thread."""
        self._keeper.start()

    def close(self) -> None:
        """End that thread."""
        self._keeper.close()

    def stats(self) -> dict[str, Any]:
        """Figures for health messages."""
        return self.store.stats()

    def curves(
        self, channels: Sequence[str], start_ms: float, end_ms: float, points: int, memory: Memory = (0, {})
    ) -> dict[str, Any]:
        """Curves from ``start_ms`` to before ``end_ms`` UTC ms, and the intervals and alarms there, JSON-ready.

        There are at most ``points`` (2 or more) times ``t``, ms. ``v`` has by channel ``min`` and ``max`` of all
        samples from each time to the next, None where there are none; the first step begins at or before ``start_ms``.
        Where a step is one frame, ``t`` are the frames' own times and there is no ``max``. Channels are those of the
        frames, or ``prediction/<model>/<output>``; of one that was not recorded all is None. ``memory`` has what may
        not be recorded yet. ``complete`` is false where something is left out, for want of time or because it is too
        much. Never call it on an event loop.

        Raises ``CellwattError`` for a span that is none, and where the folder cannot be read.
        """
        start, end = span_of(start_ms, end_ms)
        recordings, until = self.store.recordings() if self._recorded else [], time.monotonic() + PATIENCE
        asked = _Asked(recordings, list(dict.fromkeys(channels)), start, end, max(points, 2), until, memory)
        try:
            found = self._moments(asked) or self._levels(asked)
            told = marks(self.store, recordings, start, end, until)
        except OSError as error:
            raise RecordingError(f"record.folder {self.store.folder} cannot be read: {why(error)}") from error
        complete = found.pop("complete") and told.pop("complete")
        return {**found, **told, "from_record": self._recorded, "complete": complete}

    # short spans ----------------------------------------------------------------------------------

    def _moments(self, asked: _Asked) -> dict[str, Any] | None:
        """Curves out of the frames; None where levels serve better."""
        start, end, points, names = asked.start, asked.end, asked.points, asked.names
        if end - start > MOMENTS or end - start >= points * FINER:
            return None
        beside = (end - start) // (points - 1) + BESIDE  # the first and the last step reach beyond the span
        first, last = start - beside, end + beside
        try:
            found = read(self.store, near(asked.recordings, first, last), first, last, names, asked.until)
        except TimeoutError:
            return None
        found.step = found.step or asked.memory[0]
        for name, held in asked.memory[1].items():
            found.pieces[name].append(held)
        samples = {name: found.of(name, start, end) for name in names}
        times, step = _times(found, [time for time, _ in samples.values()])
        if len(times) <= points:
            values = {name: {"min": _plain(_placed(times, *samples[name]))} for name in names}
            return {"t": (times / 1e6).tolist(), "v": values, "step_ms": step / 1e6, "complete": True}
        grid = fitting(start, end, points, max(step, 1))
        if grid.start < first or grid.end > last:
            return None
        canvas = Canvas(grid, len(names))
        for row, name in enumerate(names):
            canvas.add_samples(row, *found.of(name, grid.start, grid.end))
        return {**_drawn(canvas, names), "complete": True}

    # long spans -----------------------------------------------------------------------------------

    def _levels(self, asked: _Asked) -> dict[str, Any]:
        """Curves out of the level files; those that are missing are made, newest first, as far as there is time."""
        level, grid = chosen(asked.start, asked.end, asked.points)
        canvas, complete = Canvas(grid, len(asked.names)), True
        for kept in reversed(near(asked.recordings, grid.start, grid.end)):
            try:
                source = self.store.source(kept, asked.until)
            except TimeoutError:
                complete = False
                continue
            if source is not None and source.start < grid.end and source.end >= grid.start:
                complete &= self._drawn(kept, source, level, asked.names, canvas)
        for row, name in enumerate(asked.names):
            if name in asked.memory[1]:
                canvas.add_samples(row, *asked.memory[1][name])
        return {**_drawn(canvas, asked.names, EXACT), "complete": complete}

    def _drawn(self, kept: RecordFile, source: Source, level: int, names: list[str], canvas: Canvas) -> bool:
        """Put the levels of a recording on the canvas; false where the level file is damaged, or went meanwhile."""
        try:
            found = source.levels(level, names)
        except FileNotFoundError:
            return not kept.path.exists()  # with its recording, or to keep to the budget
        except ValueError as error:
            self.store.spoiled(kept, str(error))
            return False
        for columns, buckets in found:
            place = {name: i for i, name in enumerate(columns)}
            for row, name in enumerate(names):
                if (i := place.get(name)) is not None:
                    canvas.add(row, STEPS[level], buckets.index, buckets.low[i], buckets.high[i])
        return True


def _times(found: Moments, times: list[NDArray[np.int64]]) -> tuple[NDArray[np.int64], int]:
    """All times of the samples, one more in each gap, and the usual step from one to the next, ns."""
    every = np.unique(np.concatenate([np.empty(0, np.int64), *times]))
    apart = np.diff(every)
    step = found.step or (round(float(np.median(apart))) if len(apart) else 0)
    gaps = every[:-1][apart > 1.5 * step] + step
    return np.sort(np.concatenate([every, gaps])), step


def _placed(times: NDArray[np.int64], at: NDArray[np.int64], values: Float) -> Float:
    """Values at some of the times, NaN at the others."""
    out = np.full(len(times), np.nan)
    out[np.searchsorted(times, at)] = values
    return out


def _drawn(canvas: Canvas, names: Sequence[str], digits: int | None = None) -> dict[str, Any]:
    grid: Grid = canvas.grid
    times = (grid.first + np.arange(grid.count)) * grid.step
    low, high = (v if digits is None else significant(v, digits) for v in (canvas.low, canvas.high))
    values = {name: {"min": _plain(low[row]), "max": _plain(high[row])} for row, name in enumerate(names)}
    return {"t": (times / 1e6).tolist(), "v": values, "step_ms": grid.step / 1e6}


def _plain(values: Float) -> list[float | None]:
    """Values for JSON, None for what is no number."""
    plain: list[float | None] = np.where(np.isfinite(values), values, np.array(None)).tolist()
    return plain


log = logging.getLogger(__name__)

PERIOD: Final = 2.0
"""s from one look at the folder to the next."""
WORK, REST = 0.01, 0.03
"""s of reading, and of rest after it: the page's other threads go first."""


class _Over(Exception):  # noqa: N818
    pass


class Keeper:
    """Keeps a store up to date from ``start`` to ``close``."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self._rest_at = 0.0
        self.looks = 0
        """Looks at the folder that are done."""

    def start(self) -> None:
        """Begin."""
        self._over.clear()
        self._thread = threading.Thread(target=self._run, name="levels", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End, in the middle of a recording if need be."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def look(self) -> None:
        """Look at the folder once: make what is missing of closed recordings, newest first, remove what is over."""
        store = self._store
        if store.room():
            store.let_go()
            for kept in reversed(store.recordings()):
                if kept.closed and store.budget.allows(kept.name):
                    store.made(kept, math.inf, self._pace)
        store.tidy()

    def _run(self) -> None:
        while not self._over.is_set():
            try:
                self.look()
            except _Over:
                return
            except OSError as error:
                self._wrong(why(error))
            except CellwattError as error:
                self._wrong(str(error))
            self.looks += 1
            self._over.wait(PERIOD)

    def _wrong(self, reason: str) -> None:
        self._store.counts["failed looks"] += 1
        self._store.problem = reason
        log.warning("the record cannot be followed: %s", reason)

    def _pace(self) -> None:
        """Rest after some work; end where all is to end."""
        now = time.monotonic()
        if now < self._rest_at:
            return
        if self._over.wait(REST):
            raise _Over
        self._rest_at = time.monotonic() + WORK
