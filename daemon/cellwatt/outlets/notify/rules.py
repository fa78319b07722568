"""Decides what a recipient is told of an alarm, and when: severity, kinds, quiet times, groups, repeats. Pure."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Final

from cellwatt.alarms import SEVERITIES
from cellwatt.outlets.notify.told import Episode, Item, Message, Told, rank
from cellwatt.results import Alarm, Severity

AGAIN: Final = 600 * 10**9
"""Time, ns, after the start of the daemon in which an alarm that is raised again is the one that was told before."""


@dataclass(frozen=True, slots=True)
class Rules:
    """What one recipient wants; times in s. ``queue`` alarms may wait."""

    severity: Severity = "warning"
    kinds: tuple[str, ...] = ("*",)
    group: float = 30.0
    repeat: float | None = None
    resolved: bool = True
    queue: int = 100

    def wants(self, alarm: Alarm) -> bool:
        """True if an alarm is grave enough, and of a kind that is asked for."""
        return rank(alarm) >= SEVERITIES.index(self.severity) and any(fnmatchcase(alarm.kind, k) for k in self.kinds)

    # alarms -----------------------------------------------------------------------------------------

    def take(self, told: Told, alarm: Alarm, session: int, passing: int) -> None:
        """Take a message of the alarm book; ``passing`` is the least rank that passes now."""
        ended, at = told.ended.get(alarm.id, (-1, 0))
        if ended == session and alarm.time <= at:
            return  # it was told to its end, and is given again
        episode = told.episodes.get(alarm.id)
        if alarm.active:
            self._active(told, alarm, episode, session, passing)
        elif episode is not None:
            self._clear(told, alarm, episode, session, passing)

    def _active(self, told: Told, alarm: Alarm, episode: Episode | None, session: int, passing: int) -> None:
        held = rank(alarm) < passing
        if episode is None:
            if self.wants(alarm):
                self._wait(told, Item("raised", alarm, held), session)
            return
        told.see(alarm, session)
        if rank(alarm) > episode.said and self.wants(alarm):
            waits = told.due.get((alarm.id, False))
            what = waits.what if waits is not None and waits.what == "raised" else "graver"
            self._wait(told, Item(what, alarm, held), session)

    def _clear(self, told: Told, alarm: Alarm, episode: Episode, session: int, passing: int) -> None:
        waits = told.due.get((alarm.id, False))
        kept_back = waits is not None and rank(waits.alarm) < passing
        if kept_back or (episode.told and waits is not None and waits.what == "repeated"):
            told.drop(alarm.id)
        if self.resolved and (episode.told or (waits is not None and not kept_back)):
            self._wait(told, Item("cleared", alarm, rank(alarm) < passing), session)
        else:
            told.end(alarm.id, alarm.time)

    def _wait(self, told: Told, item: Item, session: int) -> None:
        """Let an item wait; without room the least grave one of all, the newest of these, is only counted."""
        full = len(told.due) >= self.queue and item.slot not in told.due
        told.wait(item, session)
        if full:
            least = min(reversed(told.due.values()), key=lambda waits: rank(waits.alarm))
            told.drop(least.alarm.id, counted=True)

    # times ------------------------------------------------------------------------------------------

    def withdraw(self, told: Told, session: int, now: int) -> None:
        """End alarms of an earlier session that did not come again; ``now`` UTC ns."""
        if now < session + AGAIN:
            return
        for episode in list(told.episodes.values()):
            if episode.session == session or episode.over:
                continue
            alarm = episode.alarm
            text = f"Not seen again since the daemon began anew: {alarm.statement}"
            clear = replace(alarm, active=False, time=max(now, alarm.time), statement=text)
            if episode.told and self.resolved:
                self._wait(told, Item("cleared", clear), session)
            elif (alarm.id, False) not in told.due:
                told.end(alarm.id, clear.time)

    def again(self, told: Told, alarm_ids: Iterable[str], session: int, passing: int) -> None:
        """Tell alarms once more, where they were told and are not over."""
        for alarm_id in alarm_ids:
            episode = told.episodes.get(alarm_id)
            if episode is not None and episode.told and not episode.over and (alarm_id, False) not in told.due:
                self._wait(told, Item("repeated", episode.alarm, rank(episode.alarm) < passing), session)


def shelved(told: Told, alarm_id: str) -> None:
    """Keep silent of an alarm that a person put on the shelf: what waits of it is not told."""
    if (alarm_id, False) in told.due:
        told.drop(alarm_id, forgotten=True)


def ready(told: Told, passing: int) -> list[Item]:
    """Items that wait and pass now, in the order in which they came; what waits of one alarm stays together."""
    return [i for i in told.due.values() if max(rank(waits.alarm) for waits in told.waiting(i.alarm.id)) >= passing]


def message(to: str, items: Collection[Item], more: int, now: int) -> Message:
    """Make a message for the recipient ``to`` at ``now``, UTC ns; its id depends on all that."""
    parts = [f"{item.what} {item.alarm.since} {item.alarm.time} {item.alarm.id}" for item in items]
    digest = hashlib.sha256("\n".join([to, str(now), str(more), *parts]).encode()).hexdigest()
    return Message(digest[:32], now, tuple(items), more)
