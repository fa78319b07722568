"""A process that runs one chain of stages on the frames."""

from __future__ import annotations

import contextlib
import logging
import resource
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from cellwatt.frames import Frames
from cellwatt.results import Result
from cellwatt.ring import ItemReader, ItemWriter, Mark, Status
from cellwatt.runtime.assemble import declared, make_chain
from cellwatt.runtime.processes.rights import settle_memory
from cellwatt.runtime.processes.shared import OTHERS, REPORT_EVERY, Assignment, Ready, figures
from cellwatt.runtime.processes.waiting import turns

log = logging.getLogger(__name__)

QUEUED_FRAMES: Final = 500
"""Largest number of frames that wait for a chain (10 s at 50 Hz); beyond it the oldest are dropped and counted."""
MEMORY: Final = 2 << 30
"""Largest memory in bytes of the stages of a chain; a stage that needs more is created again."""
FIRST_TO_GO: Final = 500
"""``oom_score_adj`` of judges: when memory runs out, the kernel ends them before the other processes."""


def judge(assignment: Assignment) -> None:
    """Run the stages until the frames end or other judges replace them. Raises ``ConfigError`` as ``make_chain``."""
    _give_way()
    _Judging(assignment).run()


def _give_way() -> None:
    """Limit memory and be the first to be ended when it runs out, as far as the unit allows.

    Judges have the niceness of the daemon: with a lower priority, alarms came 15 s late beside busy programs.
    """
    for step in (
        lambda: resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY)),
        lambda: Path("/proc/self/oom_score_adj").write_text(f"{FIRST_TO_GO}\n"),
    ):
        with contextlib.suppress(OSError, ValueError):
            step()


class _Judging:
    def __init__(self, assignment: Assignment) -> None:
        shared, config = assignment.shared, assignment.config
        self._assignment = assignment
        self._held = assignment.held
        self._in = ItemReader(shared.frames, OTHERS + assignment.slot)
        self._out = ItemWriter(shared.results[assignment.slot])
        _, self._layout = declared(config)
        self._fitting: dict[int, bool] = {}
        if not self._held:
            self._begin()
        self._chain = make_chain(config, self._layout, assignment.stages)
        self._time = 0
        self._following: int | None = None
        self._dropped = self._waiting = self._refused = 0
        self._reported_at = 0.0

    def run(self) -> None:
        control = self._assignment.control
        control.send(Ready())
        settle_memory()
        replaced = False
        for _ in turns(self._in, control):
            if replaced := not self._turn():
                break
            if time.monotonic() - self._reported_at >= REPORT_EVERY:
                self._report()
        self._give(self._chain.close())
        if replaced:
            self._give(self._chain.take_back(self._time))
        self._report(replaced=replaced)
        self._out.end()

    def _begin(self) -> None:
        """Announce that these stages begin, so that active alarms of earlier ones are withdrawn."""
        self._held = False
        self._out.put(Status({"begun": self._assignment.stages}))

    def _turn(self) -> bool:
        """Process the present frames; return ``False`` if other judges have taken over."""
        for item in self._in.items():
            # Settled before the work, so that a block that crashes a stage is not given to its successor.
            self._in.settle()
            if isinstance(item, Frames):
                self._take(item)
            elif isinstance(item, Mark) and item.generation > self._assignment.generation:
                return False
            elif isinstance(item, Mark) and item.generation == self._assignment.generation and self._held:
                self._begin()
        return True

    def _take(self, frames: Frames) -> None:
        if self._held or not self._fits(frames):
            return
        if self._following is not None:
            self._dropped += max(frames.sequence - self._following, 0)
        self._following = frames.sequence + len(frames)
        self._time = int(frames.time[-1])
        self._waiting = self._in.newest() - self._following
        if self._waiting > QUEUED_FRAMES:
            self._dropped += len(frames)
        else:
            self._give(self._chain.process(frames))
        if time.monotonic() - self._reported_at >= REPORT_EVERY:
            self._report()

    def _fits(self, frames: Frames) -> bool:
        fits = self._fitting.get(id(frames.layout))
        if fits is None:
            fits = self._fitting[id(frames.layout)] = frames.layout == self._layout
        return fits

    def _give(self, results: Iterable[Result]) -> None:
        for result in results:
            try:
                self._out.put(result)
            except ValueError:
                self._refused += 1
                if self._refused == 1:
                    log.exception("a result of the stages %s cannot be passed on", ", ".join(self._chain.names))

    def _report(self, **more: bool) -> None:
        self._reported_at = time.monotonic()
        stages = {
            name: known | {"dropped": self._dropped, "waiting": max(self._waiting, 0)}
            for name, known in self._chain.status().items()
        }
        name, refused = f"judge {'+'.join(self._chain.names)}", self._refused
        self._out.put(Status(figures(name, self._assignment, refused=refused, stages=stages, **more)))
