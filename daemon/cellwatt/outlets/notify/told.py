"""All that is known of one recipient: alarms that were told, what waits, what is on its way. Pure.

It changes by entries alone, and the ledger writes each of them down: reading them again gives the same knowledge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated, Final, Literal

from pydantic import Field, TypeAdapter

from cellwatt.alarms import SEVERITIES
from cellwatt.results import Alarm

ENDED: Final = 2000
"""Alarms that are over of which the time of the end is kept, so that none is told once more."""

Happening = Literal["raised", "graver", "repeated", "cleared"]


def rank(alarm: Alarm) -> int:
    """Rank of the severity of an alarm, 0 for the least."""
    return SEVERITIES.index(alarm.severity)


@dataclass(frozen=True, slots=True)
class Item:
    """Something to tell about one alarm; ``held``: it came in a quiet time that keeps it back."""

    what: Happening
    alarm: Alarm
    held: bool = False

    @property
    def slot(self) -> tuple[str, bool]:
        """Only one item in each slot waits: the alarm, and its end."""
        return self.alarm.id, self.what == "cleared"


@dataclass(frozen=True, slots=True)
class Message:
    """Items that are sent together; ``id`` is the same at every attempt, ``made`` UTC ns.

    ``more`` items found no room, ``settled`` are addresses of it that need no further attempt.
    """

    id: str
    made: int
    items: tuple[Item, ...] = ()
    more: int = 0
    settled: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Episode:
    """One alarm from its raise to its clear, as this recipient knows it.

    ``alarm`` is its newest message, ``session`` that in which it was last raised, ``said`` the gravest rank that was
    put into an item; ``told``: an item of it was put into a message. ``over``: its clear waits.
    """

    alarm: Alarm
    session: int
    said: int
    told: bool = False
    over: bool = False


# entries ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Due:
    """An item is to be told."""

    item: Item
    session: int
    kind: Literal["due"] = "due"


@dataclass(frozen=True, slots=True)
class Dropped:
    """What waits of an alarm is not told; ``counted`` where it found no room, ``forgotten`` where it may come again."""

    alarm: str
    counted: bool = False
    forgotten: bool = False
    kind: Literal["dropped"] = "dropped"


@dataclass(frozen=True, slots=True)
class Seen:
    """An alarm is up in this session; a clear of it that waits is not told."""

    alarm: Alarm
    session: int
    kind: Literal["seen"] = "seen"


@dataclass(frozen=True, slots=True)
class Over:
    """An alarm ended, and nothing is told of it; ``time`` UTC ns."""

    alarm: str
    time: int
    kind: Literal["over"] = "over"


@dataclass(frozen=True, slots=True)
class Made:
    """A message was made of items that waited."""

    message: Message
    kind: Literal["made"] = "made"


@dataclass(frozen=True, slots=True)
class Settled:
    """Addresses of the message on its way need no further attempt."""

    addresses: tuple[str, ...]
    kind: Literal["settled"] = "settled"


@dataclass(frozen=True, slots=True)
class Ended:
    """The message on its way was accepted, or is given up."""

    message: str
    accepted: bool
    kind: Literal["ended"] = "ended"


@dataclass(frozen=True, slots=True)
class Whole:
    """Everything that is known, in place of all entries before."""

    episodes: tuple[Episode, ...]
    due: tuple[Item, ...]
    flight: Message | None
    ended: tuple[tuple[str, tuple[int, int]], ...]
    more: int
    kind: Literal["whole"] = "whole"


Entry = Annotated[Due | Dropped | Seen | Over | Made | Settled | Ended | Whole, Field(discriminator="kind")]
ENTRY: Final[TypeAdapter[Entry]] = TypeAdapter(Entry)


@dataclass(slots=True)
class Told:
    """What is known of one recipient."""

    episodes: dict[str, Episode] = field(default_factory=dict)
    due: dict[tuple[str, bool], Item] = field(default_factory=dict)
    flight: Message | None = None
    ended: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Session and time of the end, UTC ns, of alarms that are over, by id."""
    more: int = 0
    """Items that found no room since the last message."""

    def whole(self) -> Whole:
        """All of it as one entry."""
        ended = tuple(self.ended.items())
        return Whole(tuple(self.episodes.values()), tuple(self.due.values()), self.flight, ended, self.more)

    def waiting(self, alarm_id: str) -> Iterator[Item]:
        """Items of an alarm that are in no message yet."""
        return (self.due[slot] for slot in ((alarm_id, False), (alarm_id, True)) if slot in self.due)

    def lasts(self, entry: Entry) -> bool:
        """True if an entry is to be kept on disk: newer figures of an alarm alone are not."""
        if not isinstance(entry, Seen):
            return True
        episode = self.episodes.get(entry.alarm.id)
        return episode is not None and (episode.over or episode.session != entry.session)

    def apply(self, entry: Entry) -> None:
        """Take one entry."""
        match entry:
            case Due(item, session):
                self._due(item, session)
            case Dropped(alarm_id, counted, forgotten):
                self._dropped(alarm_id, counted, forgotten)
            case Seen(alarm, session):
                self._seen(alarm, session)
            case Over(alarm_id, time):
                self._end(alarm_id, time)
            case Made(message):
                self._made(message)
            case Settled(addresses):
                if self.flight is not None:
                    self.flight = replace(self.flight, settled=(*self.flight.settled, *addresses))
            case Ended():
                self.flight = None
            case Whole():
                self.episodes = {episode.alarm.id: episode for episode in entry.episodes}
                self.due = {item.slot: item for item in entry.due}
                self.flight, self.ended, self.more = entry.flight, dict(entry.ended), entry.more

    def _due(self, item: Item, session: int) -> None:
        self.due[item.slot] = item
        before = self.episodes.get(item.alarm.id)
        if item.what == "cleared":
            if before is not None:
                self.episodes[item.alarm.id] = replace(before, over=True)
        else:
            told, said = (before.told, before.said) if before is not None else (False, -1)
            self.episodes[item.alarm.id] = Episode(item.alarm, session, max(said, rank(item.alarm)), told)

    def _dropped(self, alarm_id: str, counted: bool, forgotten: bool) -> None:
        items = list(self.waiting(alarm_id))
        for item in items:
            del self.due[item.slot]
        if counted:
            self.more += 1
        episode = self.episodes.get(alarm_id)
        if episode is not None and (episode.over or (forgotten and not episode.told)):
            if episode.over:
                self._end(alarm_id, items[-1].alarm.time if items else episode.alarm.time)
            else:
                del self.episodes[alarm_id]

    def _seen(self, alarm: Alarm, session: int) -> None:
        episode = self.episodes.get(alarm.id)
        if episode is not None:
            self.episodes[alarm.id] = replace(episode, alarm=alarm, session=session, over=False)
            self.due.pop((alarm.id, True), None)
            item = self.due.get((alarm.id, False))
            if item is not None:
                self.due[item.slot] = replace(item, alarm=alarm)

    def _made(self, message: Message) -> None:
        self.flight, self.more = message, 0
        for item in message.items:
            self.due.pop(item.slot, None)
            episode = self.episodes.get(item.alarm.id)
            if item.what == "cleared":
                self._end(item.alarm.id, item.alarm.time)
            elif episode is not None:
                self.episodes[item.alarm.id] = replace(episode, told=True)

    def _end(self, alarm_id: str, time: int) -> None:
        episode = self.episodes.pop(alarm_id, None)
        self.ended.pop(alarm_id, None)
        if episode is not None:
            self.ended[alarm_id] = episode.session, time
        while len(self.ended) > ENDED:
            del self.ended[next(iter(self.ended))]
