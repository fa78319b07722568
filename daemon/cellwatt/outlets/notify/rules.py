"""State of one recipient, and the rules that decide which alarms it is sent, and when. Pure."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

from pydantic import TypeAdapter

from cellwatt.alarms import SEVERITIES
from cellwatt.outlets.selection import fits
from cellwatt.results import Alarm, Severity

ENDED: Final = 2000
"""Number of cleared alarms whose end time is stored, so that no alarm is sent twice."""

Happening = Literal["raised", "graver", "repeated", "cleared"]


def rank(alarm: Alarm) -> int:
    """Rank of the severity of an alarm, 0 for the least."""
    return SEVERITIES.index(alarm.severity)


@dataclass(frozen=True, slots=True)
class Item:
    """One change of one alarm to report."""

    what: Happening
    alarm: Alarm

    @property
    def slot(self) -> tuple[str, bool]:
        """Key of the waiting item: at most one for the active alarm and one for its clear."""
        return self.alarm.id, self.what == "cleared"


@dataclass(frozen=True, slots=True)
class Notification:
    """Items that are sent together; ``id`` is the same at every attempt, ``made`` is UTC ns.

    ``more``: number of items dropped from a full queue.
    """

    id: str
    made: int
    items: tuple[Item, ...] = ()
    more: int = 0


@dataclass(frozen=True, slots=True)
class Episode:
    """One alarm from its raise to its clear, as this recipient knows it.

    ``alarm`` is its newest message, ``session`` the session in which it was last active, ``said`` the highest rank
    put into an item; ``told``: an item was put into a message; ``over``: the clear waits to be sent.
    """

    alarm: Alarm
    session: int
    said: int
    told: bool = False
    over: bool = False


_Saved = tuple[list[Episode], list[Item], Notification | None, dict[str, tuple[int, int]], int]
_SAVED: Final[TypeAdapter[_Saved]] = TypeAdapter(_Saved)


@dataclass(slots=True)
class Recipient:
    """State of one recipient: known alarms, waiting items ``due``, and the message being sent, ``flight``."""

    episodes: dict[str, Episode] = field(default_factory=dict)
    due: dict[tuple[str, bool], Item] = field(default_factory=dict)
    flight: Notification | None = None
    ended: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Session and end time, UTC ns, of cleared alarms, by id."""
    more: int = 0
    """Number of items dropped from the full queue since the last message."""
    changed: bool = field(default=False, compare=False)
    """The state must be saved to disk. Newer evidence of a known alarm alone does not set this."""
    counts: Counter[str] = field(default_factory=Counter, compare=False)
    """Counts of dropped items, for the account."""

    def saved(self) -> Any:
        """The state to save, JSON-ready."""
        all_ = list(self.episodes.values()), list(self.due.values()), self.flight, self.ended, self.more
        return _SAVED.dump_python(all_, mode="json")

    @classmethod
    def read(cls, saved: Any) -> Recipient:
        """The state from the value of ``saved``. Raises ``ValueError``."""
        episodes, due, flight, ended, more = _SAVED.validate_python(saved)
        return cls({e.alarm.id: e for e in episodes}, {i.slot: i for i in due}, flight, ended, more)

    def waiting(self, alarm_id: str) -> Iterator[Item]:
        """Items of an alarm that are not in a message yet."""
        return (self.due[slot] for slot in ((alarm_id, False), (alarm_id, True)) if slot in self.due)

    def wait(self, item: Item, session: int) -> None:
        """Add a waiting item."""
        self.due[item.slot] = item
        before = self.episodes.get(item.alarm.id)
        if item.what != "cleared":
            told, said = (before.told, before.said) if before is not None else (False, -1)
            self.episodes[item.alarm.id] = Episode(item.alarm, session, max(said, rank(item.alarm)), told)
        elif before is not None:
            self.episodes[item.alarm.id] = replace(before, over=True)
        self.changed = True

    def drop(self, alarm_id: str, *, counted: bool = False, forgotten: bool = False) -> None:
        """Discard the waiting items of an alarm.

        ``counted``: the queue was full; ``forgotten``: the alarm may be sent again later.
        """
        items = list(self.waiting(alarm_id))
        for item in items:
            del self.due[item.slot]
        if counted:
            self.more += 1
            self.counts["without room"] += 1
        self.changed = True
        episode = self.episodes.get(alarm_id)
        if episode is not None and episode.over:
            self.end(alarm_id, items[-1].alarm.time if items else episode.alarm.time)
        elif episode is not None and forgotten and not episode.told:
            del self.episodes[alarm_id]

    def see(self, alarm: Alarm, session: int) -> None:
        """Note that a known alarm is active in this session; discard its waiting clear."""
        episode = self.episodes[alarm.id]
        self.changed = self.changed or episode.over or episode.session != session
        self.episodes[alarm.id] = replace(episode, alarm=alarm, session=session, over=False)
        self.due.pop((alarm.id, True), None)
        if (item := self.due.get((alarm.id, False))) is not None:
            self.due[item.slot] = replace(item, alarm=alarm)

    def end(self, alarm_id: str, time: int) -> None:
        """Store the end of an alarm at ``time``, UTC ns; nothing more is sent about it."""
        self.changed = True
        episode = self.episodes.pop(alarm_id, None)
        self.ended.pop(alarm_id, None)
        if episode is not None:
            self.ended[alarm_id] = episode.session, time
        while len(self.ended) > ENDED:
            del self.ended[next(iter(self.ended))]

    def send(self, message: Notification) -> None:
        """Start sending a message of waiting items."""
        self.flight, self.more, self.changed = message, 0, True
        for item in message.items:
            self.due.pop(item.slot, None)
            episode = self.episodes.get(item.alarm.id)
            if item.what == "cleared":
                self.end(item.alarm.id, item.alarm.time)
            elif episode is not None:
                self.episodes[item.alarm.id] = replace(episode, told=True)

    def arrived(self) -> None:
        """Note that the current message was accepted or given up."""
        self.flight, self.changed = None, True


AGAIN: Final = 600 * 10**9
"""Time, ns, after the daemon's start within which a re-raised alarm continues the one sent before the start."""


@dataclass(frozen=True, slots=True)
class Rules:
    """Which alarms one recipient wants. At most ``queue`` items wait."""

    severity: Severity = "warning"
    kinds: tuple[str, ...] = ("*",)
    resolved: bool = True
    queue: int = 100

    def wants(self, alarm: Alarm) -> bool:
        """True if severity and kind of an alarm are selected."""
        return rank(alarm) >= SEVERITIES.index(self.severity) and fits(alarm.kind, self.kinds)

    # alarms -----------------------------------------------------------------------------------------

    def take(self, state: Recipient, alarm: Alarm, session: int, passing: int) -> None:
        """Process a message of the alarm book; ``passing`` is the least rank that may be sent now."""
        ended, at = state.ended.get(alarm.id, (-1, 0))
        if ended == session and alarm.time <= at:
            return  # already sent up to its end, and offered again
        episode = state.episodes.get(alarm.id)
        if alarm.active:
            self._active(state, alarm, episode, session)
        elif episode is not None:
            self._clear(state, alarm, episode, session, passing)

    def _active(self, state: Recipient, alarm: Alarm, episode: Episode | None, session: int) -> None:
        if episode is None:
            if self.wants(alarm):
                self._wait(state, Item("raised", alarm), session)
            return
        state.see(alarm, session)
        if rank(alarm) > episode.said and self.wants(alarm):
            self._wait(state, Item("graver" if episode.told else "raised", alarm), session)

    def _clear(self, state: Recipient, alarm: Alarm, episode: Episode, session: int, passing: int) -> None:
        waits = state.due.get((alarm.id, False))
        withheld = waits is not None and rank(waits.alarm) < passing
        if withheld or (episode.told and waits is not None and waits.what == "repeated"):
            state.drop(alarm.id)
        if self.resolved and (episode.told or (waits is not None and not withheld)):
            self._wait(state, Item("cleared", alarm), session)
        else:
            state.end(alarm.id, alarm.time)

    def _wait(self, state: Recipient, item: Item, session: int) -> None:
        """Add a waiting item; if the queue is full, drop and count the newest of the least severe ones."""
        full = len(state.due) >= self.queue and item.slot not in state.due
        state.wait(item, session)
        if full:
            least = min(reversed(state.due.values()), key=lambda waits: rank(waits.alarm))
            state.drop(least.alarm.id, counted=True)

    # times ------------------------------------------------------------------------------------------

    def withdraw(self, state: Recipient, session: int, now: int) -> None:
        """End alarms of an earlier session that were not raised again; ``now`` is UTC ns."""
        if now < session + AGAIN:
            return
        for episode in list(state.episodes.values()):
            if episode.session == session or episode.over:
                continue
            alarm = episode.alarm
            text = f"Not raised again since the daemon restarted: {alarm.statement}"
            clear = replace(alarm, active=False, time=max(now, alarm.time), statement=text)
            if episode.told and self.resolved:
                self._wait(state, Item("cleared", clear), session)
            elif (alarm.id, False) not in state.due:
                state.end(alarm.id, clear.time)

    def again(self, state: Recipient, alarm_ids: Iterable[str], session: int) -> None:
        """Repeat alarms that were sent and are still active."""
        for alarm_id in alarm_ids:
            episode = state.episodes.get(alarm_id)
            if episode is not None and episode.told and not episode.over and (alarm_id, False) not in state.due:
                self._wait(state, Item("repeated", episode.alarm), session)


def silence(state: Recipient, alarm_id: str) -> None:
    """Discard the waiting items of an alarm that was shelved or needs no repetition."""
    if (alarm_id, False) in state.due:
        state.drop(alarm_id, forgotten=True)


def ready(state: Recipient, passing: int) -> list[Item]:
    """Waiting items that may be sent now, in the order of arrival; the items of one alarm are sent together."""
    return [i for i in state.due.values() if max(rank(waits.alarm) for waits in state.waiting(i.alarm.id)) >= passing]


def message_of(to: str, items: Collection[Item], more: int, now: int) -> Notification:
    """Make a message for the recipient ``to`` at ``now``, UTC ns; its id is a hash of all arguments."""
    parts = [f"{item.what} {item.alarm.since} {item.alarm.time} {item.alarm.id}" for item in items]
    digest = hashlib.sha256("\n".join([to, str(now), str(more), *parts]).encode()).hexdigest()
    return Notification(digest[:32], now, tuple(items), more)
