"""Alarms from raise to clear, put together from the messages of several recordings. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from cellwatt.outlets.page.levels.gathering import Said
from cellwatt.results import Alarm, Event

RESTARTED = "The daemon ended while this was active; the next one tells anew what still holds."
"""Statement of the end of an alarm that nobody cleared."""


@dataclass
class Episode:
    """One alarm: its newest ``alarm`` message that was active, times in UTC ns, and what people said of it.

    ``cleared`` is None while it is up; ``raised`` is the time of its ``first`` message.
    """

    alarm: Alarm
    first: Alarm
    session: int
    raised: int
    cleared: int | None = None
    cleared_statement: str | None = None
    words: list[Event] = field(default_factory=list)
    pack: str | None = None
    """File of the evidence, as the daemon told it."""

    def overlaps(self, start: int, end: int) -> bool:
        """True if it was up at some time from ``start`` to before ``end`` UTC ns."""
        return self.raised < end and (self.cleared is None or self.cleared >= start)

    def end(self, time: int, statement: str) -> None:
        """It is over."""
        self.cleared, self.cleared_statement = time, statement


def episodes(told: Iterable[tuple[int, Said]], sessions: Sequence[int]) -> list[Episode]:
    """Alarms by time of raise; ``told`` are sessions (UTC ns of their start) and messages in recorded order.

    ``sessions`` are all that are known: the alarms of one end with the begin of the next.
    """
    found: list[Episode] = []
    up: dict[str, Episode] = {}
    words: list[Event] = []
    for session, said in told:
        for episode in [episode for episode in up.values() if episode.session != session]:
            _end_of_session(episode, sessions)
            del up[episode.alarm.id]
        for alarm in said.alarms:
            _take(alarm, session, up, found)
        words += said.words
    for episode in up.values():
        _end_of_session(episode, sessions)
    _attach(words, found)
    return sorted(found, key=lambda episode: episode.raised)


def _take(alarm: Alarm, session: int, up: dict[str, Episode], found: list[Episode]) -> None:
    episode = up.get(alarm.id)
    if episode is not None and episode.alarm.since != alarm.since and alarm.active:
        episode.end(alarm.since, alarm.statement)  # its clear is lost
        episode = None
    if episode is None:
        episode = Episode(alarm, alarm, session, alarm.time if alarm.active else alarm.since)
        found.append(episode)
    if alarm.active:
        episode.alarm = alarm
        up[alarm.id] = episode
    else:
        episode.end(alarm.time, alarm.statement)
        up.pop(alarm.id, None)


def _end_of_session(episode: Episode, sessions: Sequence[int]) -> None:
    """A daemon that has ended holds no alarm up."""
    later = [session for session in sessions if session > episode.session]
    if episode.cleared is None and later:
        episode.end(max(min(later), episode.alarm.time), RESTARTED)


def _attach(words: Iterable[Event], found: Iterable[Episode]) -> None:
    """Give each event to the alarms that it is about: the last of each id that was raised before."""
    by_id: dict[str, list[Episode]] = {}
    for episode in found:
        by_id.setdefault(episode.alarm.id, []).append(episode)
    for word in words:
        for alarm_id in _ids(word.data):
            before = [episode for episode in by_id.get(alarm_id, ()) if episode.raised <= word.time]
            if not before:
                continue
            if word.kind != "evidence":
                before[-1].words.append(word)
            elif "pack" in word.data:
                start = word.data.get("start", 0)
                inside = (episode for episode in before if episode.raised >= start and episode.pack is None)
                next(inside, before[-1]).pack = str(word.data["pack"])


def _ids(data: Mapping[str, object]) -> list[str]:
    several = data.get("alarms")
    ids = several if isinstance(several, list | tuple) else [data.get("alarm")]
    return [alarm_id for alarm_id in ids if isinstance(alarm_id, str)]
