"""The process that records and publishes: the record, outlets and answers, health."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import select
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, Final

from cellwatt.batch import Batch, Tick
from cellwatt.frames import Frames
from cellwatt.gather import next_moment
from cellwatt.processor import starved
from cellwatt.results import Event, series_of
from cellwatt.ring import ItemReader, Mark, RingJournal, Status
from cellwatt.runtime.assemble import declared
from cellwatt.runtime.chain import BEGINS_ANEW
from cellwatt.runtime.change import Change
from cellwatt.runtime.processes.resume import Resume
from cellwatt.runtime.processes.rights import keep_up, settle_memory
from cellwatt.runtime.processes.shared import (
    PUBLISHED,
    TELL,
    TELLS,
    Alive,
    Apply,
    Assignment,
    InForce,
    Ready,
    Refused,
    figures,
)
from cellwatt.runtime.processes.waiting import ALONE
from cellwatt.runtime.tasks import Tasks, plain_errors
from cellwatt.runtime.teller import Teller
from cellwatt.ticker import Ticker

log = logging.getLogger(__name__)

HEALTH_RATE: Final = 1.0  # Hz
AT_ONCE: Final = 100
"""Largest number of items of one ring that are processed before other tasks of the loop run."""
MARKED: Final = 3.0
"""Longest time, s, that new settings wait for the last frames of the old ones: less than the rings hold."""
ALIVE: Final = 5.0
"""Longest time, s, between messages to the supervisor, which systemd's watchdog awaits."""
SILENT: Final = 4.0
"""s without figures after which a process is reported as down, or as starved if it gets no processor time …"""
HUNG: Final = 60.0
"""… and after which the supervisor kills a process that is down: the rings hold 10 s, so its data are lost anyway."""


def tell(assignment: Assignment) -> None:
    """Record and publish until all other processes have ended. Raises ``CellwattError`` if an outlet cannot start."""
    keep_up()
    with plain_errors():
        asyncio.run(_Telling(assignment).run())


class _Way:
    """The reader of one ring; ``checkpoints`` are the recorder's item counts and the ring positions they belong to."""

    def __init__(self, reader: ItemReader) -> None:
        self.reader = reader
        self.checkpoints: deque[tuple[int, int]] = deque()
        self.held = False
        """True while this ring waits for others to reach the same settings."""


class _Telling:
    def __init__(self, assignment: Assignment) -> None:
        shared = assignment.shared
        self._assignment = assignment
        self._config, self._generation = assignment.config, assignment.generation
        self._teller = Teller(assignment.config, shared.session, shared.clock.now, RingJournal(*shared.journal))
        self._teller.on_health = self._report_alive
        self._teller.behind = assignment.restarts > 0
        self._raw = _Way(ItemReader(shared.raw, TELL))
        self._frames = _Way(ItemReader(shared.frames, TELL))
        self._results = [_Way(ItemReader(ring, TELL)) for ring in shared.results]
        self._ways = [self._raw, self._frames, *self._results]
        self._reports: dict[str, tuple[float, Mapping[str, Any]]] = {}
        self._applying: asyncio.Queue[Apply] = asyncio.Queue()
        self._next: asyncio.Handle
        """The next call of ``_turn``."""
        self._marked = asyncio.Event()
        self._over = asyncio.Event()
        self._lag = 0.0
        self._behind = False
        """True if a ring has more new items than the last turn processed."""
        self._alive = 0.0, ""
        """Monotonic s and text of the last status sent to the supervisor."""
        self._reported_skipped = 0
        """Overwritten bytes that events have reported so far."""

    async def run(self) -> None:
        control, loop = self._assignment.control, asyncio.get_running_loop()
        async with asyncio.TaskGroup() as group:
            self._tasks = Tasks(group)
            await self._teller.start(self._tasks, *declared(self._config))
            await self._resume_record()
            helpers = [group.create_task(self._heart()), group.create_task(self._apply())]
            for way in self._ways:
                loop.add_reader(way.reader.bell, self._rung, way)
            self._next = loop.call_soon(self._turn)
            loop.add_reader(control.fileno(), self._hear)
            control.send(Ready())
            settle_memory()
            await self._over.wait()
            loop.remove_reader(control.fileno())
            self._next.cancel()
            for way in self._ways:
                loop.remove_reader(way.reader.bell)
            for helper in helpers:
                helper.cancel()
            self._check()
            await self._teller.close(self._tasks)
        self._settle()

    async def _resume_record(self) -> None:
        """Find the end of the record, and record items that the previous process published but did not record."""
        series = {series_of(item) for _, item in self._teller.journaled()}
        self._resume = await Resume.of(self._teller.recorder, series, restarts=self._assignment.restarts)
        if self._teller.behind:
            self._teller.catch_up(self._resume.unrecorded(self._teller.journaled()))

    # rings ----------------------------------------------------------------------------------------

    def _turn(self) -> None:
        """Process new items of all rings; the next turn is at the next common time or, if nothing came, the next item.

        Each check of the cell's health starts a turn, too.
        """
        loop, gather = asyncio.get_running_loop(), self._gather
        self._next.cancel()
        most = max([self._drain(way) for way in self._ways if not way.reader.over], default=0)
        self._behind = most == AT_ONCE
        if all(way.reader.over and not way.held for way in self._ways):
            self._over.set()
        elif self._behind:
            self._next = loop.call_soon(self._turn)
        elif most and gather:
            self._next = loop.call_at(next_moment(gather, TELLS), self._turn)
            for way in self._results:
                way.reader.listen()
        else:
            waiting = [way.reader.listen() and not way.held for way in self._ways]
            if any(waiting):
                self._next = loop.call_soon(self._turn)

    @property
    def _gather(self) -> float:
        """s for which samples gather at present, also in *collect*."""
        awaited = self._raw.reader.ring.awaited = self._teller.awaited
        gather = self._config.gather(awaited=awaited)
        if self._teller.recorder is not None:
            self._teller.recorder.gathered = gather
        return gather

    def _rung(self, way: _Way) -> None:
        way.reader.quiet()
        if gather := self._gather:
            self._next.cancel()
            self._next = asyncio.get_running_loop().call_at(next_moment(gather, TELLS), self._turn)
        elif self._drain(way) == AT_ONCE or way.reader.listen() or way.reader.over:
            self._turn()

    def _drain(self, way: _Way) -> int:
        """Process the next items of a ring, at most ``AT_ONCE``; return their number, without figures."""
        before = way.reader.count
        for item in () if way.held else way.reader.items():
            self._take(way, item)
            if way.held or way.reader.count - before == AT_ONCE:
                break
        taken = self._teller.recorder.progress()[0] if self._teller.recorder is not None else 0
        if way.checkpoints and way.checkpoints[-1][0] == taken:
            way.checkpoints.pop()  # the next one counts as much; while a disk is full, they would fill the memory
        if not way.checkpoints or way.checkpoints[-1][1] != way.reader.position:
            way.checkpoints.append((taken, way.reader.position))
        return way.reader.count - before

    def _take(self, way: _Way, item: Any) -> None:
        match item:
            case Status():
                self._note_figures(way, item.figures)
            case Mark():
                if item.generation > self._generation:  # the ring has reached newer settings and is held
                    way.held = True  # until the remaining frames of the old ones have come
                    self._marked.set()
            case Batch() | Frames():
                fresh = self._resume.fresh(item)
                if fresh is not None:
                    self._teller.record(fresh)
                self._teller.tell(item)
            case Tick():
                self._teller.record(item)
            case _:  # a result or event; the ring stores which ones a previous process published
                if self._unpublished(way):
                    self._teller.take(item)
                elif self._resume.lacks(item):
                    self._teller.record(item)

    def _note_figures(self, way: _Way, figures: Mapping[str, Any]) -> None:
        if "begun" in figures:
            if self._unpublished(way):
                self._teller.withdraw(figures["begun"], BEGINS_ANEW)
        elif figures.get("replaced"):
            self._reports.pop(figures["part"], None)
        else:
            self._reports[figures["part"]] = time.monotonic(), figures

    def _unpublished(self, way: _Way) -> bool:
        """Return whether the last item read is still unpublished, and mark it as published."""
        reader = way.reader
        unpublished = reader.position > reader.ring.position(PUBLISHED)
        if unpublished:
            reader.ring.settle(PUBLISHED, reader.position)
        return unpublished

    def _settle(self) -> None:
        """Settle items that are in the file, or are not recorded, so that a successor does not read them again."""
        recorder = self._teller.recorder
        settled = recorder.progress()[1] if recorder is not None else 0
        for way in self._ways:
            while way.checkpoints and way.checkpoints[0][0] <= settled:
                way.reader.ring.settle(way.reader.reader, way.checkpoints.popleft()[1])

    # settings -------------------------------------------------------------------------------------

    def _hear(self) -> None:
        try:
            message = self._assignment.control.recv()
        except (EOFError, OSError):  # the supervisor has ended: the others end by themselves
            loop = asyncio.get_running_loop()
            loop.remove_reader(self._assignment.control.fileno())
            loop.call_later(ALONE, self._over.set)
            return
        if isinstance(message, Refused):
            self._teller.refused = message.reason
            return
        assert isinstance(message, Apply)
        self._applying.put_nowait(message)

    async def _apply(self) -> None:
        while True:
            message = await self._applying.get()
            change = Change.between(self._config, message.config)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(MARKED):
                    while change.frames and not (self._raw.held and self._frames.held):
                        self._marked.clear()
                        await self._marked.wait()
            await self._change(message, change)
            self._raw.held = self._frames.held = False
            self._turn()
            with contextlib.suppress(OSError):  # the supervisor has ended: the rings still hold items to publish
                self._assignment.control.send(InForce())

    async def _change(self, message: Apply, change: Change) -> None:
        await self._teller.stop(self._tasks, change.outlets)
        self._config, self._generation = message.config, message.generation
        self._teller.change(self._tasks, message.config, change.outlets)
        if change.frames:
            self._teller.redeclare(*declared(message.config))
            self._reports = {part: known for part, known in self._reports.items() if "stages" not in known[1]}
        self._teller.take(Event(self._assignment.shared.clock.now(), None, "reloaded", str(change)))

    # health ---------------------------------------------------------------------------------------

    def _report_alive(self, status: Mapping[str, Any]) -> None:
        control, now, line = self._assignment.control, time.monotonic(), in_one_line(status)
        if line == self._alive[1] and now - self._alive[0] < ALIVE:
            return
        with contextlib.suppress(OSError):  # the supervisor has ended: this process ends by itself
            if select.select([], [control], [], 0)[1]:  # a supervisor that hangs must not block this process
                known = status["processes"].values()
                control.send(Alive(line, tuple(p["pid"] for p in known if p["down"] and p["silent_s"] > HUNG)))
                self._alive = now, line

    async def _heart(self) -> None:
        count = -1
        async with Ticker(HEALTH_RATE) as ticker:
            async for tick in ticker:
                self._lag = tick.lateness
                before, count = count, sum(way.reader.count for way in self._ways)
                if count == before:
                    ticker.skip()  # no items: every other second is enough
                self._assignment.shared.clock.discipline()
                self._turn()
                self._settle()
                self._check()

    def _check(self) -> None:
        """Check the cell's health. A fault of the check must not stop the data, nor the end of the record."""
        try:
            self._look()
        except Exception:
            log.exception("the check of the cell's health failed")

    @property
    def _skipped(self) -> int:
        """Bytes that were overwritten before this process read them."""
        return sum(way.reader.skipped for way in self._ways)

    def _look(self) -> None:
        # Also at the last check, so that the record reports all skipped bytes.
        lost, self._reported_skipped = self._skipped - self._reported_skipped, self._skipped
        if lost > 0:
            text = f"{lost} bytes were overwritten before they could be recorded: this PC is too busy"
            self._teller.take(Event(self._assignment.shared.clock.now(), None, "skipped", text))
        now = time.monotonic()
        if self._behind or self._lag > SILENT:  # figures of the others may still be unread
            self._reports = {part: (now, known) for part, (_, known) in self._reports.items()}
        reported = {part: known for part, (_, known) in self._reports.items()}
        ages = {part: now - heard for part, (heard, _) in self._reports.items()}
        ending = self._raw.reader.ring.ended  # the other processes have ended in order
        silent = {part for part, age in ages.items() if age > SILENT and not ending}
        waiting = {part for part in silent if starved(reported[part]["pid"], reported[part]["cpu_s"], ages[part])}
        stages = {name: s for known in reported.values() for name, s in known.get("stages", {}).items()}
        collect, align = reported.get("collect", {}), reported.get("align", {})
        lag = round(1e3 * self._lag, 3)
        here = figures("tell", self._assignment, loop_lag_ms=lag, skipped_bytes=self._skipped)
        self._teller.look(
            {
                "utc_error_ms": collect.get("utc_error_ms", 0.0),
                "loop_lag_ms": collect.get("loop_lag_ms", 0.0),
                "sources": collect.get("sources", {}),
                "frames": align.get("frames", {"count": 0, "streams": {}}),
                "stages": {name: stages[name] for name in self._config.stages if name in stages},
                "processes": {
                    part: {k: v for k, v in known.items() if k not in ("part", "sources", "stages", "frames")}
                    | {
                        "silent_s": round(ages.get(part, 0.0), 1),
                        "down": part in silent - waiting,
                        "starved": part in waiting,
                    }
                    for part, known in {**reported, "tell": here}.items()
                },
            }
        )


def in_one_line(status: Mapping[str, Any]) -> str:
    """State of the cell in one line."""
    up = sum(s["state"] == "ok" for s in status["sources"].values())
    text = f"{status['state']}: {up} of {len(status['sources'])} sources up, {len(status['alarms'])} alarms"
    reason = " ".join(status["reasons"][0].split()) if status["reasons"] else ""
    return f"{text}; {reason}" if reason else text
