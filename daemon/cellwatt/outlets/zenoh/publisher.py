"""The thread that owns the Zenoh session: opens it, publishes the outbox, closes it."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from cellwatt.batch import Batch
from cellwatt.errors import OutletError
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.answers import STUCK, Answers
from cellwatt.outlets.zenoh.encode import ARROW, JSON, encode_apart
from cellwatt.outlets.zenoh.keys import FRAME, HEALTH, CellKeys
from cellwatt.outlets.zenoh.link import LARGEST_MESSAGE, LinkSettings, open_session, why_unconnected
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import encode_item
from cellwatt.outlets.zenoh.outbox import Outbox, Outgoing
from cellwatt.outlets.zenoh.questions import LARGEST
from cellwatt.outlets.zenoh.signing import MessageSigner

if TYPE_CHECKING:
    import zenoh

log = logging.getLogger(__name__)

DRAIN: Final = 1.0
"""Longest time, s, that a stop waits for the outbox to empty."""
HELD_UP: Final = 0.02
"""s for one put from which on a receiver is too slow to be served on the event loop, for the next ``HINDERED`` s."""
HINDERED: Final = 1.0
SCHEMA_EVERY: Final = 1.0
"""s between two messages of a topic that carry its schema, for consumers that came since."""
_UNCONNECTED: Final = 5.0
"""Time, s, without any link after which the log says why."""


class Publisher:
    """Publishes the outbox, by ``run`` in a thread, until ``stop``.

    Puts of results block while a receiver is slow, so they have a thread. Puts of samples, frames and health do not
    block: a receiver that cannot keep up misses some and asks for them, and no other receiver waits for it.
    ``health`` returns the health message when it is due.
    """

    def __init__(
        self,
        link: LinkSettings,
        keys: CellKeys,
        outbox: Outbox,
        answers: Answers,
        health: Callable[[], tuple[Mark, bytes]],
        seal: MessageSigner,
    ) -> None:
        self._link = link
        self._keys = keys
        self._outbox = outbox
        self._answers = answers
        self._health = health
        self._seal = seal
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._told: dict[str, tuple[int, float]] = {}
        """CRC-32 of the schema that each topic's messages had last, and when, monotonic s."""
        self._beat_due: float | None = None
        """Time, monotonic s, since which a health message is due; ``None`` if none is."""
        self._stop_at: float | None = None
        self._session: zenoh.Session | None = None
        self._hindered_until = 0.0
        self._broken: Exception | None = None
        self._interest: list[zenoh.Publisher] = []
        """Those of all samples and frames: who subscribes is known by the time that the first ones come."""
        self._health_to: zenoh.Publisher | None = None
        self._linked_at: float | None = time.monotonic()
        """When there was a link last, monotonic s; ``None`` once the log says that there is none."""

    @property
    def awaited(self) -> bool:
        """True if somebody subscribes to samples or frames."""
        return self._session is not None and any(map(_wanted, self._interest))

    def beat(self) -> None:
        """Publish a health message after the current put; a thread that waits is not woken where nobody listens."""
        to = self._health_to
        if to is not None and self._outbox.idle and not self._link.connect and not _wanted(to):
            return
        if self._beat_due is None:
            self._beat_due = time.monotonic()
        self._outbox.wake()

    def tell_schemas(self) -> None:
        """Let the next message of each topic have its schema."""
        self._told.clear()

    @property
    def direct(self) -> bool:
        """True if ``send`` may publish samples: a session is open, and no receiver has blocked a put lately."""
        return self._session is not None and time.monotonic() >= self._hindered_until

    def send(self) -> None:
        """Publish waiting samples in the caller's thread; once a put takes long, leave the rest to this thread."""
        import zenoh

        session = self._session
        while session is not None and self.direct and (outgoing := self._outbox.take_samples()) is not None:
            began = time.monotonic()
            try:
                self._put(session, outgoing)
            except zenoh.ZError as error:
                self._broken = error
            if self._broken is not None or time.monotonic() - began > HELD_UP:
                self._hindered_until = time.monotonic() + HINDERED
        if len(self._outbox) or self._broken is not None:
            self._outbox.wake()

    def trouble(self) -> str | None:
        """Reason why no message or answer goes out now; ``None`` if all is well."""
        due = self._beat_due
        if self._session is not None and due is not None and time.monotonic() - due > STUCK:
            return f"the thread that publishes has been stuck for {time.monotonic() - due:.0f} s"
        return self._answers.trouble()

    def stop(self) -> None:
        """Publish the rest of the outbox for at most ``DRAIN`` s, then end."""
        self._stop_at = time.monotonic() + DRAIN
        self._outbox.wake()

    def run(self) -> None:
        """Open, publish, close; blocks. Raises ``OutletError``."""
        import zenoh

        try:
            self._serve()
        except zenoh.ZError as error:
            raise OutletError(f"Zenoh session: {error}") from error

    def _serve(self) -> None:
        session = open_session(self._link, lambda: self._stop_at is not None, largest=_largest(self._link))
        try:
            token = session.liveliness().declare_token(self._keys.root)
            self._answers.start(session)
            self._interest = [_declare(session, self._keys.live(key), ARROW, lossy=True) for key in ("raw/**", FRAME)]
            self._health_to = _declare(session, self._keys.live(HEALTH), JSON, lossy=True)
            self._beat_due, self._session = None, session
            self._publish(session)
            token.undeclare()  # type: ignore[no-untyped-call]
        finally:
            self._session = self._health_to = None
            self._answers.stop()
            self._close(session)

    def _publish(self, session: zenoh.Session) -> None:
        while True:
            stopping = self._stop_at
            if stopping is not None and (not len(self._outbox) or time.monotonic() > stopping):
                return
            outgoing = self._outbox.take()
            if self._broken is not None:
                raise self._broken
            if outgoing is not None:
                self._put(session, outgoing)
            if self._beat_due is not None:
                self._beat_due = None
                self._put_health()
                self._look_at_links(session)

    def _put(self, session: zenoh.Session, outgoing: Outgoing) -> None:
        import zenoh

        publishers = [self._publisher(session, path, outgoing) for path in outgoing.paths]
        if isinstance(outgoing.item, Batch | Frames) and not any(map(_wanted, publishers)):
            self._outbox.sent(outgoing)
            return
        try:
            mark, payload = self._encode(outgoing)
            attachment = self._seal.message(outgoing.topic, mark.encode(payload), payload)
        except Exception:
            # One item that breaks its own contract costs that item, not the outlet.
            log.exception("zenoh: an item of %s cannot be encoded", outgoing.topic)
            self._outbox.lost(outgoing, "not encodable")
            return
        try:
            for publisher in publishers:
                publisher.put(payload, attachment=attachment)
        except zenoh.ZError:
            self._outbox.lost(outgoing, "session")
            raise
        self._outbox.sent(outgoing)

    def _encode(self, outgoing: Outgoing) -> tuple[Mark, bytes]:
        """Mark and payload of an item; samples and frames with their schema where that is due."""
        item, mark, topic = outgoing.item, outgoing.mark, outgoing.topic
        if not isinstance(item, Batch | Frames):
            return mark, encode_item(item, mark)
        check, schema, rows = encode_apart(item)
        (told, at), now = self._told.get(topic, (0, 0.0)), time.monotonic()
        if told == check and now < at + SCHEMA_EVERY:
            return replace(mark, schema=check), rows
        self._told[topic] = check, now
        return mark, schema + rows

    def _put_health(self) -> None:
        try:
            mark, payload = self._health()
            attachment = self._seal.message(HEALTH, mark.encode(payload), payload)
        except Exception:  # as of an item: some part's figures, or what a device calls itself, cannot be said
            self._outbox.count("health not encodable")
            log.exception("zenoh: the health message cannot be encoded")
            return
        assert self._health_to is not None
        self._health_to.put(payload, attachment=attachment)

    def _publisher(self, session: zenoh.Session, path: str, outgoing: Outgoing) -> zenoh.Publisher:
        publisher = self._publishers.get(path)
        if publisher is None:
            samples = isinstance(outgoing.item, Batch | Frames)
            key, encoding = self._keys.live(path), ARROW if samples else JSON
            publisher = self._publishers[path] = _declare(session, key, encoding, lossy=samples)
        return publisher

    def _look_at_links(self, session: zenoh.Session) -> None:
        """Log once when no link is up, with the reason, and once when a link is up again."""
        now = time.monotonic()
        if not self._link.connect or session.info.routers_zid() or session.info.peers_zid():
            if self._linked_at is None:
                log.info("zenoh: connected again")
            self._linked_at = now
        elif self._linked_at is not None and now - self._linked_at > _UNCONNECTED:
            log.warning("zenoh: no link for %.0f s: %s", now - self._linked_at, why_unconnected(self._link))
            self._linked_at = None

    @staticmethod
    def _close(session: zenoh.Session) -> None:
        import zenoh

        try:
            session.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:
            log.warning("zenoh: the session did not close in order: %s", error)


def _declare(session: zenoh.Session, key: str, encoding: str, *, lossy: bool) -> zenoh.Publisher:
    """Publisher of one key; a ``lossy`` one leaves a slow receiver out, another one waits for it."""
    import zenoh

    control, priority = zenoh.CongestionControl, zenoh.Priority
    return session.declare_publisher(
        key,
        encoding=encoding,
        congestion_control=control.DROP if lossy else control.BLOCK,
        priority=priority.DATA if lossy else priority.INTERACTIVE_HIGH,
        express=True,
    )


def _wanted(publisher: zenoh.Publisher) -> bool:
    """True if somebody subscribes."""
    status: Any = publisher.matching_status  # Zenoh's stubs call it a bool
    return bool(status.matching)


def _largest(link: LinkSettings) -> int:
    """Size limit in bytes of received messages: small, as a cell gets only questions unless it relays for others."""
    return LARGEST_MESSAGE if link.mode == "router" else 4 * LARGEST
