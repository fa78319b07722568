"""Publishes a cell over Zenoh."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, Final

from pydantic import model_validator

from cellwatt.batch import Batch
from cellwatt.door import validity
from cellwatt.door.signing import unusable
from cellwatt.files import unreadable
from cellwatt.frames import Frames
from cellwatt.host import stays_here
from cellwatt.outlet import CellView, Item, Outlet, refusal
from cellwatt.outlets.zenoh.answer_queue import Answer
from cellwatt.outlets.zenoh.answers import Answers
from cellwatt.outlets.zenoh.backlog import Backlog
from cellwatt.outlets.zenoh.keys import FRAME, CellKeys, raw_topic
from cellwatt.outlets.zenoh.link import (
    ADDRESS,
    LARGEST_MESSAGE,
    LinkSettings,
    close_session,
    open_beside,
    session_config,
)
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import health, topic_of
from cellwatt.outlets.zenoh.namesakes import Namesakes
from cellwatt.outlets.zenoh.publisher import Publisher
from cellwatt.outlets.zenoh.questions import LARGEST
from cellwatt.outlets.zenoh.signing import MessageSigner
from cellwatt.quantity import BytesPerSecond
from cellwatt.section import Section

_ENCRYPTED: Final = ("tls", "quic")
_ADVICE: Final = "use 127.0.0.1, or TLS with access rules as 'cellwatt secure' makes them, or set open: true"
_HARM: Final = "anyone who reaches it can read everything and impersonate the cell"


def openings(settings: LinkSettings) -> Iterator[tuple[tuple[str | int, ...], str, str]]:
    """Ways into the cell from other PCs without TLS or access rules: (setting, value, consequence as text)."""
    config = session_config(settings)
    control: dict[str, Any] = json.loads(config.get_json("access_control"))
    ruled = bool(control.get("enabled")) and control.get("default_permission") == "deny"
    listening: list[tuple[tuple[str | int, ...], str]] = [(("listen", i), e) for i, e in enumerate(settings.listen)]
    if not {"listen", "listen/endpoints"}.isdisjoint(settings.options):  # which replace the endpoints in ``listen``
        told = json.loads(config.get_json("listen/endpoints"))
        listening = [(("options",), e) for e in (told if isinstance(told, list) else chain(*told.values()))]
    for at, endpoint in listening:
        found = ADDRESS.fullmatch(endpoint)
        if found is None or stays_here(found[2].strip("[]")):
            continue  # a socket, pipe or serial line of this PC, or its loopback address
        missing = [] if found[1] in _ENCRYPTED else ["TLS"]
        missing += [] if ruled else ["access rules"]
        if missing:
            yield at, endpoint, f"open to the network without {' and '.join(missing)}: {_HARM}"
    if json.loads(config.get_json("scouting/multicast/enabled")):
        yield ("options",), "scouting", f"finds, and links with, any session on the local network: {_HARM}"


class PublishSettings(Section):
    """Data to publish live; results, alarms, events and health are always published."""

    raw: bool = True
    """Publish the samples as the sources deliver them."""
    frames: bool = True
    """Publish the aligned frames."""


class ZenohSettings(LinkSettings):
    """Publication over Zenoh."""

    publish: PublishSettings = PublishSettings()
    """Data that is published live."""
    backfill: BytesPerSecond | None = None
    """Highest data rate of answers about the past, for all consumers together; default: no limit. Set it below the
    capacity of the line minus the live data."""
    sign: Path | None = None
    """Private key (Ed25519, PEM) that signs every message and answer; ``cellwatt secure`` makes one for each cell."""
    open: bool = False
    """Allow access from the network without TLS and access rules: anyone there can read everything and impersonate the
    cell."""

    @model_validator(mode="after")
    def _closed(self) -> ZenohSettings:
        if not self.open and (found := [(at, value, f"{text}; {_ADVICE}") for at, value, text in openings(self)]):
            raise refusal(self, *found)
        return self

    def warnings(self) -> tuple[str, ...]:
        """Access left open on purpose, and keys and certificates that are missing or expire soon."""
        ways = (f"{value}: {text} (open: true)" for _, value, text in openings(self))
        doubts = () if self.tls is None else validity.warnings(self.tls.certificate, self.tls.key, self.tls.root_ca)
        return (*ways, *unreadable(self.files), *unusable(self.sign), *(f"tls.{text}" for text in doubts))


class ZenohOutlet(Outlet[ZenohSettings]):
    """Publishes raw samples, frames, results, alarms, events and health, and answers questions."""

    Settings: ClassVar[type[ZenohSettings]] = ZenohSettings
    title = "Zenoh: raw samples, frames, results and alarms, live and on request"

    def __init__(self, name: str, settings: ZenohSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._keys = CellKeys(view.site, view.cell)
        numbering = time.time_ns() if view.journal is None else view.session
        up = (standing.published for standing in view.alarms.up if standing.published is not None)
        self._backlog = Backlog(numbering, view.journal, up)
        self._seal = MessageSigner(self._keys.root, settings.sign)
        self._answers = Answers(
            view, self._keys, self._backlog, self._count, self._health, self._seal, settings.backfill
        )
        self._counting = threading.Lock()
        self._ends = self._backlog.ends
        """Session and next number, by topic: all earlier messages were sent or lost."""
        self._beats = Mark(time.time_ns(), -1, 1, 0)
        """Mark of the last health message; health has this outlet's own numbering."""
        self._status: Mapping[str, Any] = {}
        self._publisher: Publisher | None = None
        self._namesakes: Namesakes | None = None

    def offer(self, item: Item) -> None:
        """Number and publish one item."""
        if isinstance(item, Batch):
            if self.settings.publish.raw and len(item):
                topic = raw_topic(item.source, item.stream.name)
                self._send(topic, (topic,), item, Mark(self.view.session, item.sequence, len(item), item.arrival))
        elif isinstance(item, Frames):
            if self.settings.publish.frames and len(item):
                mark = Mark(self.view.session, item.sequence, len(item), int(item.time[-1]))
                self._send(FRAME, (FRAME,), item, mark)
        else:
            mark, paths = self._backlog.add(item)
            self._send(topic_of(item), paths, item, mark)

    def _send(self, topic: str, paths: Sequence[str], item: Item, mark: Mark) -> None:
        if self._publisher is None:
            self._count("not published: no session", mark.count)
        else:
            self._publisher.send(topic, paths, item, mark)
        self._ends[topic] = mark.session, mark.end

    def succeed(self, before: Outlet[Any]) -> None:
        """Take over the positions of the previous outlet."""
        if isinstance(before, ZenohOutlet):
            self._ends |= {topic: end for topic, end in before._ends.items() if end[0] == self.view.session}

    def health(self, status: Mapping[str, Any]) -> None:
        """Publish the cell's health with the current positions."""
        self._status = status
        if self._publisher is not None and (self.settings.connect or self._publisher.health_awaited):
            beats = replace(self._beats, sequence=self._beats.end, arrival=time.time_ns())
            self._publisher.send_health(beats, self._health_message(beats))
            self._beats = beats

    @property
    def awaited(self) -> bool:
        """True if a consumer subscribes to samples or frames."""
        return self._publisher is not None and self._publisher.awaited

    def trouble(self) -> str | None:
        """Reason why questions are not answered, or why consumers cannot trust what they hear, or ``None``."""
        return self._answers.trouble() or (None if self._namesakes is None else self._namesakes.trouble())

    async def run(self) -> None:
        """Open, publish until cancelled, close. Raises ``OutletError`` if no session can be opened, or it fails."""
        await asyncio.to_thread(self._seal.open)
        # Small: a cell that does not relay for others receives only questions.
        largest = LARGEST_MESSAGE if self.settings.mode == "router" else 4 * LARGEST
        session = await open_beside(self.settings, largest)
        try:
            publisher = Publisher(session, self._keys, self.account, self._seal)
            self._answers.start(session)
            self._namesakes = Namesakes(session, self._keys, self.view.session)
            self._publisher = publisher
            await publisher.watch(self.settings)
        finally:
            self._publisher = self._namesakes = None
            await asyncio.to_thread(self._answers.stop)
            await asyncio.to_thread(close_session, session)

    def _count(self, what: str, n: int = 1) -> None:
        """Count an event in the account, from any thread."""
        with self._counting:
            self.account.count(what, n)

    def _health(self) -> Answer:
        """Health as the answer to a question, with the number of the next health message.

        The questioner may have just joined: the next samples include their schema.
        """
        if self._publisher is not None:
            self._publisher.tell_schemas()
        mark = replace(self._beats, sequence=self._beats.end, arrival=time.time_ns(), backfill=True)
        return Answer(self._health_message(mark), mark=mark)

    def _health_message(self, mark: Mark) -> bytes:
        return health(mark, self.view.session, dict(self._ends), self._status or self.view.status())
