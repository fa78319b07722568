"""The process that tells: the record, outlets and answers, health."""

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
    TELL,
    TELLS,
    TOLD,
    Alive,
    Apply,
    Assignment,
    InForce,
    Ready,
    figures,
)
from cellwatt.runtime.processes.waiting import ALONE
from cellwatt.runtime.tasks import Tasks, plain_errors
from cellwatt.runtime.teller import Teller
from cellwatt.ticker import Ticker

log = logging.getLogger(__name__)

HEALTH_RATE: Final = 1.0  # Hz
AT_ONCE: Final = 100
"""Items of one ring that are dealt with before the loop may turn to something else."""
MARKED: Final = 3.0
"""Longest time, s, that new settings wait until the last frames by the old ones are told: rings hold more than that."""
ALIVE: Final = 5.0
"""s, at most, between words to the supervisor, which systemd's watchdog awaits."""
SILENT: Final = 4.0
"""s without figures after which a process is told to be down, or starved where the PC does not let it run."""


def tell(assignment: Assignment) -> None:
    """Record and publish until all others have ended. Raises ``CellwattError`` where a part cannot be started."""
    keep_up()
    with plain_errors():
        asyncio.run(_Telling(assignment).run())


class _Way:
    """One ring as it is read here; ``checkpoints`` are its positions and what the recorder had taken by then."""

    def __init__(self, reader: ItemReader) -> None:
        self.reader = reader
        self.checkpoints: deque[tuple[int, int]] = deque()
        self.held = False
        """Waits until another ring has come to the same settings."""


class _Telling:
    def __init__(self, assignment: Assignment) -> None:
        shared = assignment.shared
        self._assignment = assignment
        self._config, self._generation = assignment.config, assignment.generation
        self._teller = Teller(assignment.config, shared.session, shared.clock.now, RingJournal(*shared.told))
        self._teller.on_health = self._say_alive
        self._teller.behind = assignment.restarts > 0
        self._raw = _Way(ItemReader(shared.raw, TELL))
        self._frames = _Way(ItemReader(shared.frames, TELL))
        self._results = [_Way(ItemReader(ring, TELL)) for ring in shared.results]
        self._ways = [self._raw, self._frames, *self._results]
        self._said: dict[str, tuple[float, Mapping[str, Any]]] = {}
        self._applying: asyncio.Queue[Apply] = asyncio.Queue()
        self._next: asyncio.Handle
        """The next look at the rings."""
        self._marked = asyncio.Event()
        self._over = asyncio.Event()
        self._lag = 0.0
        self._alive = 0.0, ""
        """When the supervisor heard of the cell's health last, monotonic s, and what."""
        self._told_skipped = 0
        """Bytes of which an event told that they were written over before they were read here."""

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
            self._look()
            await self._teller.close(self._tasks)
        self._settle()

    async def _resume_record(self) -> None:
        """Find the end of the record, and record what the process before this one told and could not write any more."""
        series = {series_of(item) for _, item in self._teller.told()}
        self._resume = await Resume.of(self._teller.recorder, series, restarts=self._assignment.restarts)
        if self._teller.behind:
            self._teller.catch_up(self._resume.unrecorded(self._teller.told()))

    # rings ----------------------------------------------------------------------------------------

    def _turn(self) -> None:
        """Take what came in all rings; the next turn comes at the next moment or, if nothing came, at the next item.

        There is one with each look at the cell's health, too.
        """
        loop, gather = asyncio.get_running_loop(), self._gather
        self._next.cancel()
        most = max([self._drain(way) for way in self._ways if not way.reader.over], default=0)
        if all(way.reader.over and not way.held for way in self._ways):
            self._over.set()
        elif most == AT_ONCE:
            self._next = loop.call_soon(self._turn)
        elif most and gather:
            self._next = loop.call_at(next_moment(gather, TELLS), self._turn)
            for way in self._results:
                way.reader.listen()
        else:
            there = [way.reader.listen() and not way.held for way in self._ways]
            if any(there):
                self._next = loop.call_soon(self._turn)

    @property
    def _gather(self) -> float:
        """s for which samples gather now; who collects goes by it, too."""
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
        """Take the next items of a ring; return how many that is beside figures, ``AT_ONCE`` at most."""
        before = way.reader.count
        for item in () if way.held else way.reader.items():
            self._take(way, item)
            if way.held or way.reader.count - before == AT_ONCE:
                break
        self._note(way)
        return way.reader.count - before

    def _take(self, way: _Way, item: Any) -> None:
        match item:
            case Status():
                self._note_figures(way, item.figures)
            case Mark():
                self._come_to(way, item.generation)
            case Batch() | Frames():
                fresh = self._resume.fresh(item)
                if fresh is not None:
                    self._teller.record(fresh)
                self._teller.tell(item)
            case Tick():
                self._teller.record(item)
            case _:
                self._take_message(way, item)

    def _note_figures(self, way: _Way, figures: Mapping[str, Any]) -> None:
        if "begun" in figures:
            if self._untold(way):
                self._teller.withdraw(figures["begun"], BEGINS_ANEW)
        elif figures.get("replaced"):
            self._said.pop(figures["part"], None)
        else:
            self._said[figures["part"]] = time.monotonic(), figures

    def _take_message(self, way: _Way, item: Any) -> None:
        """Results and events: where each got to is noted in its ring."""
        if self._untold(way):
            self._teller.take(item)
        elif self._resume.lacks(item):
            self._teller.record(item)

    def _untold(self, way: _Way) -> bool:
        """True where no process before this one has told what was read last; from now on it is told."""
        reader = way.reader
        untold = reader.position > reader.ring.position(TOLD)
        if untold:
            reader.ring.settle(TOLD, reader.position)
        return untold

    def _note(self, way: _Way) -> None:
        recorder = self._teller.recorder
        taken = recorder.progress()[0] if recorder is not None else 0
        if not way.checkpoints or way.checkpoints[-1][1] != way.reader.position:
            way.checkpoints.append((taken, way.reader.position))

    def _settle(self) -> None:
        """Settle what is in the file, or needs none: who follows this process does not read it again."""
        recorder = self._teller.recorder
        settled = recorder.progress()[1] if recorder is not None else 0
        for way in self._ways:
            while way.checkpoints and way.checkpoints[0][0] <= settled:
                way.reader.ring.settle(way.reader.reader, way.checkpoints.popleft()[1])

    # settings -------------------------------------------------------------------------------------

    def _hear(self) -> None:
        try:
            message = self._assignment.control.recv()
        except (EOFError, OSError):  # the supervisor is gone: the others end by themselves
            loop = asyncio.get_running_loop()
            loop.remove_reader(self._assignment.control.fileno())
            loop.call_later(ALONE, self._over.set)
            return
        assert isinstance(message, Apply)
        self._applying.put_nowait(message)

    def _come_to(self, way: _Way, generation: int) -> None:
        """Hold a ring that is ahead of the settings here; frames that follow older ones come first."""
        if generation > self._generation:
            way.held = True
            self._marked.set()

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
            with contextlib.suppress(OSError):  # the supervisor is gone: what is in the rings is still to be told
                self._assignment.control.send(InForce(message.generation))

    async def _change(self, message: Apply, change: Change) -> None:
        await self._teller.stop(self._tasks, change.outlets)
        self._config, self._generation = message.config, message.generation
        self._teller.change(self._tasks, message.config, change.outlets)
        if change.frames:
            self._teller.redeclare(*declared(message.config))
            self._said = {part: known for part, known in self._said.items() if "stages" not in known[1]}
        self._teller.take(Event(self._assignment.shared.clock.now(), None, "reloaded", str(change)))

    # health ---------------------------------------------------------------------------------------

    def _say_alive(self, status: Mapping[str, Any]) -> None:
        control, now, line = self._assignment.control, time.monotonic(), in_one_line(status)
        if line == self._alive[1] and now - self._alive[0] < ALIVE:
            return
        with contextlib.suppress(OSError):  # the supervisor is gone: this process ends by itself
            if select.select([], [control], [], 0)[1]:  # one that hangs must hold up nobody
                control.send(Alive(line))
                self._alive = now, line

    async def _heart(self) -> None:
        count = -1
        async with Ticker(HEALTH_RATE) as ticker:
            async for tick in ticker:
                self._lag = tick.lateness
                before, count = count, sum(way.reader.count for way in self._ways)
                if count == before:
                    ticker.skip()  # nothing comes: each other second will do
                self._assignment.shared.clock.discipline()
                self._turn()
                self._settle()
                try:
                    self._look()
                except Exception:
                    # Health is worth a lot, but never the data: it is looked at again in a second.
                    log.exception("the look at the cell's health failed")

    @property
    def _skipped(self) -> int:
        """Bytes that were written over before they were read here."""
        return sum(way.reader.skipped for way in self._ways)

    def _tell_skipped(self) -> None:
        lost, self._told_skipped = self._skipped - self._told_skipped, self._skipped
        if lost > 0:
            text = f"{lost} bytes were written over before they could be recorded: this PC is too busy"
            self._teller.take(Event(self._assignment.shared.clock.now(), None, "skipped", text))

    def _look(self) -> None:
        self._tell_skipped()  # at the last look, too: what was skipped since the one before is in the record
        now = time.monotonic()
        said = {part: known for part, (_, known) in self._said.items()}
        ages = {part: now - heard for part, (heard, _) in self._said.items()}
        ending = self._raw.reader.ring.ended  # the others have come to their end, in order
        silent = {part for part, age in ages.items() if age > SILENT and not ending}
        waiting = {part for part in silent if starved(said[part]["pid"], said[part]["cpu_s"], ages[part])}
        stages = {name: s for known in said.values() for name, s in known.get("stages", {}).items()}
        collect, align = said.get("collect", {}), said.get("align", {})
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
                    for part, known in {**said, "tell": here}.items()
                },
            }
        )


def in_one_line(status: Mapping[str, Any]) -> str:
    """State of the cell in one line."""
    up = sum(s["state"] == "ok" for s in status["sources"].values())
    text = f"{status['state']}: {up} of {len(status['sources'])} sources up, {len(status['alarms'])} alarms"
    reason = " ".join(status["reasons"][0].split()) if status["reasons"] else ""
    return f"{text}; {reason}" if reason else text
