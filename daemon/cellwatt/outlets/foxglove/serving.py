"""Streams a live cell to the Foxglove app."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

from cellwatt.batch import Batch
from cellwatt.errors import ConfigError
from cellwatt.frames import Frames
from cellwatt.host import in_url, stays_here
from cellwatt.outlets.foxglove.outlet import FoxgloveOutlet, library
from cellwatt.outlets.foxglove.topics import Moment
from cellwatt.outlets.foxglove.translate import Translator
from cellwatt.record import Health as Recorded
from cellwatt.record.encoder import FRAME_TOPIC
from cellwatt.subscriber import Gap, Health, LinkSettings, Message, Subscriber

log = logging.getLogger(__name__)

LAG: Final = 0.5
"""Longest delay, s, of a moment to preserve its distance from the last one; beyond it, moments are sent faster."""
HURRY: Final = 1 / 2000
"""Interval, s, between moments sent faster: the library queues about a thousand messages per client and drops more."""
MOST: Final = 20_000
"""Largest number of waiting moments; further ones replace the oldest."""


class Pace:
    """A queue of moments, each due ``after`` s after the one before it; times are monotonic, in s."""

    def __init__(self) -> None:
        self.dropped = 0
        self._waiting: deque[tuple[float, Moment]] = deque()
        self._last = -math.inf

    def add(self, moment: Moment, now: float) -> None:
        """Append a moment."""
        at = max(now, self._last + moment.after)
        if at > now + LAG:
            at = max(now, self._last + min(moment.after, HURRY))
        self._last = at
        self._waiting.append((at, moment))
        if len(self._waiting) > MOST:
            self._waiting.popleft()
            self.dropped += 1

    def due(self, now: float) -> Iterator[Moment]:
        """Remove and yield the moments that are due."""
        while self._waiting and self._waiting[0][0] <= now:
            yield self._waiting.popleft()[1]

    def wait(self, now: float) -> float:
        """Time, s, until the next moment is due; infinite if there is none."""
        return max(0.0, self._waiting[0][0] - now) if self._waiting else math.inf


WANTED: Final = ("frame", "interval", "task", "energy", "prediction", "alarm", "event", "health")
PORT: Final = 8765
"""The default port of the app."""
_PATIENCE: Final = 2.0
"""Longest time, s, to wait for the first frame before the server listens."""
_PULSE: Final = 0.1
"""Longest time, s, between two checks for new subscriptions."""


def serve(
    link: LinkSettings,
    site: str,
    cell: str,
    *,
    host: str = "127.0.0.1",
    port: int = PORT,
    seconds: float | None = None,
    verify: Path | None = None,
    tell: Callable[[str], None] = log.info,
) -> None:
    """Serve a cell to Foxglove apps on this PC, for ``seconds`` or until Ctrl-C.

    ``verify`` is as for ``Subscriber``; ``tell`` is called with a line at the start and one at the end. Raises
    ``ConfigError`` for a host other than loopback or without the extra ``foxglove``, ``OutletError`` if the link or the
    port cannot be opened.
    """
    _refuse_others(host, port)
    library()
    translator = Translator()
    name = f"cellwatt {site}/{cell}"
    subscriber = Subscriber(site, cell, link, want=WANTED, verify=verify)
    with subscriber, FoxgloveOutlet(name, host, port, translator.topics) as outlet:
        pace = Pace()
        try:
            end = math.inf if seconds is None else time.monotonic() + seconds
            for _ in _stream(subscriber, outlet, translator, pace, end):
                tell(f"Foxglove: open a connection to ws://{in_url(host.strip('[]'))}:{outlet.port}")
        finally:
            if outlet.is_open:
                tell(_summary(outlet, pace, subscriber.counts))


def moments(translator: Translator, message: Message) -> Iterator[Moment]:
    """Convert a message of the cell to moments."""
    content = message.content
    match content:
        case Frames():
            yield from translator.frames(content)
        case Health():
            yield from translator.session(content)
            yield translator.item(Recorded(content.time, content.status))
        case Gap():
            yield translator.lost(time.time_ns(), message.topic, content.count)
        case Batch():
            return
        case _:
            yield translator.item(content)


def _stream(
    subscriber: Subscriber, outlet: FoxgloveOutlet, translator: Translator, pace: Pace, end: float
) -> Iterator[None]:
    """Stream until ``end``; yield once, when the server listens: after the fields of the frames are known."""
    opens = time.monotonic() + _PATIENCE
    while (now := time.monotonic()) < end:
        for moment in pace.due(now):
            outlet.send(moment)
        if not outlet.is_open and (outlet.knows(FRAME_TOPIC) or now >= opens):
            outlet.open()
            yield
        outlet.welcome()
        try:
            message = subscriber.receive(min(_PULSE, end - now, pace.wait(now)))
        except TimeoutError:
            continue
        now = time.monotonic()
        for moment in moments(translator, message):
            pace.add(moment, now)


def _refuse_others(host: str, port: int) -> None:
    if not stays_here(host.strip("[]")):
        raise ConfigError(
            f"Foxglove's socket has neither login nor encryption, so it is not opened on {host}; "
            f"from another PC use a tunnel: ssh -L {port}:127.0.0.1:{port} USER@THIS-PC"
        )


def _summary(outlet: FoxgloveOutlet, pace: Pace, counts: Mapping[str, int]) -> str:
    parts = [f"{outlet.sent.total()} messages sent on {len(outlet.sent)} topics"]
    if lost := counts.get("lost", 0):
        parts.append(f"{lost} samples and results lost between the cell and this command")
    bad = ("unreadable", "unsigned")
    parts += [f"{counts[kind]} messages {kind}" for kind in bad if counts.get(kind, 0)]
    if pace.dropped:
        parts.append(f"{pace.dropped} moments dropped: the cell sent them faster than they can be shown")
    if outlet.behind:
        slow = ", ".join(outlet.behind)
        parts.append(f"clients too slow, so that the library dropped their oldest messages (number unknown): {slow}")
    return "Foxglove: " + "; ".join(parts)
