"""Recording and publication: the record, outlets, health, alarms about the daemon, and answers to outlets."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from cellwatt.alarms import AlarmBook, Damping, withdrawn
from cellwatt.batch import Batch, Tick
from cellwatt.channel import Stream
from cellwatt.config import CellConfig, OutletConfig, public_config
from cellwatt.frames import Frames, Layout
from cellwatt.outlet import Journal
from cellwatt.record import Header, Health, History, Recorder
from cellwatt.registry import outlet as find_outlet
from cellwatt.results import Alarm, Energy, Event, Result, series_of
from cellwatt.ring import RingJournal
from cellwatt.runtime.acknowledgements import Acknowledgements
from cellwatt.runtime.consumption import Consumption
from cellwatt.runtime.delivery import Delivery
from cellwatt.runtime.evidence import Keeper
from cellwatt.runtime.health import colour, describe
from cellwatt.runtime.tasks import Tasks
from cellwatt.runtime.troubles import Monitor

log = logging.getLogger(__name__)

Item = Batch | Tick | Event | Frames | Result
RECHECK: Final = 3600.0
"""Time, s, after which warnings are computed again: certificates expire while the daemon runs."""


class Teller:
    """Records and publishes what it is given, judges the daemon's health, and answers outlets (``CellView``).

    ``now`` is the cell's clock. ``journal`` holds the results and events that a previous process published.
    ``on_health`` is called with the new status after each check of the health.
    """

    def __init__(
        self, config: CellConfig, session: int, now: Callable[[], int], journal: RingJournal | None = None
    ) -> None:
        self.site, self.cell, self.session, self.folder = config.site, config.cell, session, config.folder
        self.outlets: dict[str, Delivery] = {}
        self.recorder: Recorder | None = None
        self.evidence: Keeper | None = None
        self.on_health: Callable[[Mapping[str, Any]], None] = lambda _status: None
        self._config = config
        self._now = now
        self._history: History | None = None
        self._streams: Mapping[str, tuple[Stream, ...]] = {}
        self._layout = Layout((), config.frames.rate)
        self._results = 0
        self.journal: Journal | None = journal
        self.behind = False
        """The record lacks items that the journal holds: results and events wait in the journal until ``catch_up``."""
        self.alarms = AlarmBook(Damping())
        self.record_folder = None if config.record is None else config.record.folder
        self._consumption = Consumption()
        self._words = Acknowledgements(self.alarms, session, now, self.take, self._publish)
        self.acknowledge, self.shelve, self.unshelve = self._words.acknowledge, self._words.shelve, self._words.unshelve
        if journal is not None:
            journal.restore(self.alarms)
        self._watch = Monitor(standing.alarm for standing in self.alarms.raised)
        self._status: dict[str, Any] = {}
        self._displaced = 0
        self._warnings = config.warnings
        self.refused = ""
        """Reason why the changed settings file is not in force; empty if it is."""

    # life -----------------------------------------------------------------------------------------

    async def start(self, tasks: Tasks, streams: Mapping[str, tuple[Stream, ...]], layout: Layout) -> None:
        """Start the recorder and the outlets. Raises ``CellwattError`` if one of them cannot be started."""
        self._streams, self._layout = streams, layout
        if self._config.record is not None:
            self.recorder = Recorder(self._config.record, self._header(), self._now)
            await asyncio.to_thread(self.recorder.start)
            self._history = History(self._config.record.folder, self.recorder)
            folder = self._config.record.folder
            await asyncio.to_thread(self._words.read, folder)
            await asyncio.to_thread(self._consumption.read, folder, self._now())
            tasks.spawn("words", self._keep_words(folder))
            tasks.spawn("energy", self._consumption.keep(folder))
            tasks.spawn("recovery", self._report_recovery(self.recorder))
            known = [standing.alarm for standing in self.alarms.raised]
            self.evidence = Keeper(self._config.record, self.cell, self._now, self.take, known)
            tasks.spawn("evidence", self.evidence.run())
        tasks.spawn("warnings", self._keep_warnings())
        for outlet in self._config.outlets.values():
            self._start_outlet(tasks, outlet, required=not self.behind)

    async def stop(self, tasks: Tasks, names: Iterable[str]) -> None:
        """Stop the outlets ``names``."""
        await tasks.end(f"outlet {name}" for name in names)

    def change(self, tasks: Tasks, config: CellConfig, names: Iterable[str]) -> None:
        """Apply new settings: of the stopped outlets ``names``, start those that the settings still contain."""
        self._config, self._warnings, self.refused = config, config.warnings, ""
        stages = {s.alarm.stage for s in self.alarms.raised if s.alarm.stage is not None}
        self.withdraw(stages - config.stages.keys(), "is no longer part of the cell")
        for name in names:
            before = self.outlets.pop(name, None)
            if name in config.outlets:
                self._start_outlet(tasks, config.outlets[name], before)

    def redeclare(self, streams: Mapping[str, tuple[Stream, ...]], layout: Layout) -> None:
        """Begin a new file, because the streams or the layout of the frames change."""
        self._streams, self._layout = streams, layout
        if self.recorder is not None:
            self.recorder.redeclare(self._header())

    async def close(self, tasks: Tasks) -> None:
        """Let outlets and the record finish what is queued."""
        await self.stop(tasks, self.outlets)
        await tasks.end(["evidence", "words", "energy", "warnings"])
        if self._config.record is not None:
            await self._words.keep(self._config.record.folder)
            await self._consumption.write(self._config.record.folder)
        if self.recorder is not None:
            await self.recorder.close()
        if self.evidence is not None:
            await self.evidence.close()

    def _header(self) -> Header:
        config = self._config
        return Header(self.site, self.cell, self.session, config.robot, config.text, self._streams)

    async def _report_recovery(self, recorder: Recorder) -> None:
        for recovery in await recorder.upkeep.recovered():
            self.take(Event(self._now(), None, "recovered", str(recovery)))

    async def _keep_words(self, folder: Path) -> None:
        """Save acknowledgements and shelves to disk on each change; a disk error is logged once until it is over."""
        reported = None
        while True:
            problem = await self._words.keep(folder)
            if problem is not None and problem != reported:
                log.warning("acknowledgements and shelves cannot be saved for a restart: %s", problem)
            reported = problem
            await self._words.changed.wait()

    async def _keep_warnings(self) -> None:
        while True:
            await asyncio.sleep(RECHECK)
            config = self._config
            found = await asyncio.to_thread(getattr, config, "warnings")
            if config is self._config:
                self._warnings = found

    def _start_outlet(
        self, tasks: Tasks, config: OutletConfig, before: Delivery | None = None, *, required: bool = False
    ) -> None:
        make = partial(find_outlet(config.name), config.name, config.settings, self)
        delivery = self.outlets[config.name] = Delivery(config.name, make, before, required=required)
        for warning in config.settings.warnings():
            log.warning("outlet %s: %s", config.name, warning)
        tasks.spawn(f"outlet {config.name}", delivery.run())

    # data -----------------------------------------------------------------------------------------

    def take(self, item: Item) -> None:
        """Record one item and hand it to the outlets; never blocks."""
        number = None
        if isinstance(item, Result | Event) and not isinstance(item, Alarm):  # alarms are numbered when published
            number = self._number(item)
        self.record(item, number)
        if not isinstance(item, Tick):
            self.tell(item)

    def record(self, item: Item, number: int | None = None) -> None:
        """Record one item if the cell has a record; a result or event under its number."""
        if self.recorder is not None and (number is None or not self.behind):
            self.recorder.put(item, number)

    def journaled(self) -> Iterator[tuple[int, Result | Event]]:
        """Results and events of the journal that belong into the record, with their numbers, each series in order."""
        for number, item in self.journal.past() if self.journal is not None else ():
            if not isinstance(item, Alarm):
                yield number, item

    def catch_up(self, items: Iterable[tuple[int, Result | Event]]) -> None:
        """Record ``items``, which are published and missing in the record, and record new ones directly again."""
        self.behind = False
        for number, item in items:
            self.record(item, number)

    def _number(self, item: Result | Event) -> int | None:
        """The number under which an item is published and recorded; None without a journal, or if it does not fit."""
        try:
            return None if self.journal is None else self.journal.put(item)
        except ValueError as error:
            log.warning("a message of %s cannot be stored for a restart: %s", series_of(item), error)
            return None

    def tell(self, item: Batch | Event | Frames | Result) -> None:
        """Hand one item to the outlets; for an alarm, the messages that the alarm book returns."""
        if not isinstance(item, Batch | Frames | Event):
            self._results += 1
        if isinstance(item, Alarm):
            new = item.id not in self.alarms
            self._publish(self.alarms.take(item), new=new)
        else:
            if isinstance(item, Frames):
                self._consumption.add(item)
            elif isinstance(item, Energy):
                self._consumption.end(item)
            self._offer(item)

    @property
    def awaited(self) -> bool:
        """True if a consumer waits for samples or frames."""
        return any(outlet.awaited for outlet in self.outlets.values())

    def withdraw(self, stages: Collection[str], why: str) -> None:
        """Clear the active alarms of ``stages``, with the reason."""
        active = [s.alarm for s in self.alarms.raised if s.holds and s.alarm.stage in stages]
        for clear in withdrawn(active, self._now(), why):
            self.take(clear)

    def _publish(self, alarms: Iterable[Alarm], *, new: bool = True) -> None:
        for alarm in alarms:
            if new or not alarm.active:
                log.warning("%s: %s", alarm.severity if alarm.active else "cleared", alarm.statement)
            self._offer(alarm)
            if self.evidence is not None:
                self.evidence.alarm(alarm)

    def _offer(self, item: Batch | Event | Frames | Result) -> None:
        if isinstance(item, Alarm):
            self._number(item)
        for outlet in self.outlets.values():
            outlet.offer(item)

    # health ---------------------------------------------------------------------------------------

    def look(self, parts: Mapping[str, Any]) -> None:
        """Judge the daemon's health by the figures ``parts`` of its processes, and publish it."""
        now = self._now()
        status = self._status = self._measure(now, parts)
        for alarm in self._watch.look(status, now):
            self.take(alarm)
        self._publish(self.alarms.look(now))
        self._words.changed.set()  # an acknowledged or shelved alarm may have changed
        status["results"] = self._results
        status["state"] = colour(status, self._watch.troubles)
        status["reasons"] = [trouble.statement for trouble in self._watch.troubles]
        status |= self.alarms.status()
        for outlet in self.outlets.values():
            outlet.health(status)
        if self.recorder is not None:
            self.recorder.put(Health(now, status))
            if (displaced := status["recorder"]["displaced"]["files"]) != self._displaced:
                self._displaced = displaced
                self._words.write_again()
        self.on_health(status)

    def _measure(self, now: int, parts: Mapping[str, Any]) -> dict[str, Any]:
        return {
            "site": self.site,
            "cell": self.cell,
            "session": self.session,
            "time": now,
            **parts,
            "warnings": self._warnings,
            "refused_settings": self.refused,
            **self._consumption.status(),
            "task": self._consumption.task,
            "sinks": {name: outlet.status() for name, outlet in self.outlets.items()},
            "recorder": self.recorder.stats() if self.recorder is not None else None,
            "evidence": self.evidence.stats() if self.evidence is not None else None,
        }

    # answers to outlets (cellwatt.outlet.CellView) -------------------------------------------------------

    def status(self) -> Mapping[str, Any]:
        """See ``CellView.status``."""
        return self._status

    def config(self) -> Mapping[str, Any]:
        """See ``CellView.config``."""
        return public_config(self._config)

    def schema(self) -> Mapping[str, Any]:
        """See ``CellView.schema``."""
        return describe(self._layout, self._streams)

    def recordings(self) -> Sequence[Mapping[str, Any]]:
        """See ``CellView.recordings``."""
        return self._history.recordings() if self._history is not None else ()

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> Sequence[Batch]:
        """See ``CellView.history``."""
        return self._history.history(source, stream, session, first, count) if self._history is not None else ()

    def frame_history(self, session: int, first: int, count: int) -> Sequence[Frames]:
        """See ``CellView.frame_history``."""
        return self._history.frames(session, first, count) if self._history is not None else ()

    def result_history(self, series: str, session: int, first: int, count: int) -> Sequence[tuple[int, Result | Event]]:
        """See ``CellView.result_history``."""
        return self._history.results(series, session, first, count) if self._history is not None else ()
