"""The process that makes frames from the collected samples."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable
from typing import Final

from cellwatt.align import Aligner
from cellwatt.batch import Batch, Tick
from cellwatt.frames import Frames
from cellwatt.gather import next_moment
from cellwatt.ring import ItemReader, ItemWriter, Mark, Status
from cellwatt.runtime.assemble import declared
from cellwatt.runtime.processes.rights import keep_up, settle_memory
from cellwatt.runtime.processes.shared import ALIGN, ALIGNS, REPORT_EVERY, Apply, Assignment, Ready, figures
from cellwatt.runtime.processes.waiting import turns

UNGATHERED: Final = 0.004
"""Period in s of reading when samples do not gather: frames are emitted later than that anyway."""
BEFORE: Final = 3.0
"""s before the last frame from which a restarted process reads the samples again, so that its frames are the same."""


def align(assignment: Assignment) -> None:
    """Make frames until *collect* has ended."""
    keep_up()
    _Aligning(assignment).run()


class _Aligning:
    def __init__(self, assignment: Assignment) -> None:
        shared = assignment.shared
        self._assignment = assignment
        self._config, self._generation = assignment.config, assignment.generation
        self._in = ItemReader(shared.raw, ALIGN)
        self._out = ItemWriter(shared.frames)
        self._streams, _ = declared(self._config)
        self._aligner = self._following(*self._out.frames())
        self._fitting: dict[int, bool] = {}
        """Whether a stream, by ``id``, belongs to the present settings."""
        self._read: deque[tuple[float, int]] = deque()
        self._reported_at = 0.0

    def _following(self, sequence: int, after: int) -> Aligner:
        """An aligner by the present settings, for the frames from number ``sequence`` on, later than ``after`` ns."""
        grid = self._config.frames
        return Aligner(self._streams, grid.rate, grid.latency, sequence=sequence, after=after)

    def run(self) -> None:
        self._out.put(Mark(self._generation))
        self._assignment.control.send(Ready())
        settle_memory()
        for _ in turns(self._in, self._assignment.control, self._moment):
            for item in self._in.items():
                self._take(item)
            self._look(time.monotonic())
        self._give(self._aligner.flush())
        self._report()
        self._out.end()

    def _moment(self) -> float:
        """Time of the next reading, monotonic s, according to the present settings."""
        return next_moment(self._config.gather(awaited=False) or UNGATHERED, ALIGNS)

    def _take(self, item: object) -> None:
        match item:
            case Batch() if self._fits(item):
                self._give(self._aligner.add(item))
            case Tick():
                self._give(self._aligner.add(item))
            case Mark() if item.generation > self._generation:
                self._change(item.generation)

    def _fits(self, batch: Batch) -> bool:
        """True if a batch belongs to the present settings; a restarted process may read older batches."""
        fits = self._fitting.get(id(batch.stream))
        if fits is None:
            fits = self._fitting[id(batch.stream)] = batch.stream in self._streams.get(batch.source, ())
        return fits

    def _give(self, blocks: Iterable[Frames]) -> None:
        for frames in blocks:
            self._out.put(frames)

    def _change(self, generation: int) -> None:
        while self._generation < generation:
            message = self._assignment.control.recv()
            assert isinstance(message, Apply)
            self._config, self._generation = message.config, message.generation
        self._give(self._aligner.flush())
        self._streams, _ = declared(self._config)
        self._aligner = self._following(self._aligner.sequence, self._aligner.reached)
        self._fitting.clear()
        self._out.put(Mark(generation))

    def _look(self, now: float) -> None:
        self._read.append((now, self._in.position))
        while self._read[0][0] < now - BEFORE:
            self._in.ring.settle(ALIGN, self._read.popleft()[1])
        if now - self._reported_at >= REPORT_EVERY:
            self._reported_at = now
            self._report()

    def _report(self) -> None:
        status = figures("align", self._assignment, skipped_bytes=self._in.skipped, frames=self._aligner.status())
        self._out.put(Status(status))
