"""Publishes a cell's items over an open Zenoh session, from the event loop."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from cellwatt.account import Account
from cellwatt.batch import Batch
from cellwatt.errors import OutletError
from cellwatt.frames import Frames
from cellwatt.outlet import Item
from cellwatt.outlets.zenoh.encode import ARROW, JSON, encode_apart
from cellwatt.outlets.zenoh.keys import FRAME, HEALTH, CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, why_unconnected
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import encode_item
from cellwatt.outlets.zenoh.signing import MessageSigner
from cellwatt.results import Alarm, Prediction

if TYPE_CHECKING:
    import zenoh

log = logging.getLogger(__name__)

SCHEMA_EVERY: Final = 1.0
"""Time, s, between two messages of a topic with its schema, for consumers that subscribed since."""
_SLOW: Final = 0.1
"""Shortest duration, s, of a put that counts as having waited for a receiver."""
_PAUSE: Final = 1.0
"""Time, s, after such a put in which no results but alarms are published."""
_UNCONNECTED: Final = 5.0
"""Time, s, without any link after which the reason is logged."""
_LOOK: Final = 0.5
"""Time, s, between two checks of the links."""


class Publisher:
    """Publishes at once. A receiver that cannot keep up blocks the loop for 1 s at most, and then not for a while.

    Samples, frames, predictions and health do not wait for a slow receiver: it misses some and requests them later.
    For other results, each receiver has a queue of thousands; a receiver that accepts none while its queue is full is
    disconnected after 1 s. After a result that had to wait, only alarms are published for 1 s: consumers request the
    others later.
    """

    def __init__(self, session: zenoh.Session, keys: CellKeys, account: Account, seal: MessageSigner) -> None:
        self._session = session
        self._keys = keys
        self._account = account
        self._seal = seal
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._told: dict[str, tuple[int, float]] = {}
        """CRC-32 of the schema last published on each topic, and the time of publication, monotonic s."""
        self._paused = 0.0
        """Monotonic time, s, until which only alarms are published."""
        self._broken: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._interest = [self._declare(path, ARROW, lossy=True) for path in ("raw/**", FRAME)]
        """Publishers on all sample and frame keys, declared early: subscribers are known before the first data."""
        self._health_to = self._declare(HEALTH, JSON, lossy=True)
        self._token = session.liveliness().declare_token(keys.root)

    @property
    def awaited(self) -> bool:
        """True if a consumer subscribes to samples or frames."""
        return any(map(_wanted, self._interest))

    @property
    def health_awaited(self) -> bool:
        """True if a consumer subscribes to health."""
        return _wanted(self._health_to)

    def tell_schemas(self) -> None:
        """Include the schema in the next message of each topic."""
        self._told.clear()

    def send(self, topic: str, paths: Sequence[str], item: Item, mark: Mark) -> None:
        """Publish an item of a topic under its paths; count it as sent, dropped or not published."""
        import zenoh

        lossy = isinstance(item, Batch | Frames | Prediction)
        if not lossy and not isinstance(item, Alarm) and time.monotonic() < self._paused:
            self._account.count("not published: a slow receiver", mark.count)
            return
        self._account.expect(mark.count)
        try:
            self._put(topic, paths, item, mark, lossy=lossy)
        except zenoh.ZError as error:
            self._account.drop(mark.count, "session")
            self._break(error)

    def _put(self, topic: str, paths: Sequence[str], item: Item, mark: Mark, *, lossy: bool) -> None:
        """Publish an item already counted as expected. Raises ``ZError``."""
        samples = isinstance(item, Batch | Frames)
        publishers = [self._publisher(path, ARROW if samples else JSON, lossy=lossy) for path in paths]
        if samples and not any(map(_wanted, publishers)):
            self._account.receive(mark.count)
            return
        try:
            mark, payload = self._encode(topic, item, mark)
            attachment = self._seal.message(topic, mark.encode(payload), payload)
        except Exception:
            # An item that violates its contract is dropped; the outlet continues.
            log.exception("zenoh: an item of %s cannot be encoded", topic)
            self._account.drop(mark.count, "not encodable")
            return
        begun = time.monotonic()
        for publisher in publishers:
            publisher.put(payload, attachment=attachment)
        now = time.monotonic()
        if not lossy and now - begun > _SLOW:
            self._paused = now + _PAUSE
        self._account.receive(mark.count)

    def send_health(self, mark: Mark, payload: bytes) -> None:
        """Publish a health message."""
        import zenoh

        try:
            self._health_to.put(payload, attachment=self._seal.message(HEALTH, mark.encode(payload), payload))
        except zenoh.ZError as error:
            self._break(error)

    async def watch(self, link: LinkSettings) -> None:
        """Log once when all links are down, with the reason, and once when a link is up again.

        Raises ``OutletError`` when the session accepts no more messages.
        """
        linked_at: float | None = time.monotonic()
        while not self._broken.done():
            await asyncio.wait([self._broken], timeout=_LOOK if link.connect else None)
            now = time.monotonic()
            if not link.connect or self._session.info.routers_zid() or self._session.info.peers_zid():
                if linked_at is None:
                    log.info("zenoh: connected again")
                linked_at = now
            elif linked_at is not None and now - linked_at > _UNCONNECTED:
                reason = await asyncio.to_thread(why_unconnected, link)
                log.warning("zenoh: no link for %.0f s: %s", now - linked_at, reason)
                linked_at = None
        self._broken.result()

    def _break(self, error: Exception) -> None:
        if not self._broken.done():
            self._broken.set_exception(OutletError(f"Zenoh session: {error}"))

    def _encode(self, topic: str, item: Item, mark: Mark) -> tuple[Mark, bytes]:
        """Mark and payload of an item; samples and frames include their schema when it is due."""
        if not isinstance(item, Batch | Frames):
            return mark, encode_item(item, mark)
        check, schema, rows = encode_apart(item)
        (told, at), now = self._told.get(topic, (0, 0.0)), time.monotonic()
        if told == check and now < at + SCHEMA_EVERY:
            return replace(mark, schema=check), rows
        self._told[topic] = check, now
        return mark, schema + rows

    def _publisher(self, path: str, encoding: str, *, lossy: bool) -> zenoh.Publisher:
        publisher = self._publishers.get(path)
        if publisher is None:
            publisher = self._publishers[path] = self._declare(path, encoding, lossy=lossy)
        return publisher

    def _declare(self, path: str, encoding: str, *, lossy: bool) -> zenoh.Publisher:
        """Publisher of one key; a ``lossy`` publisher skips a slow receiver, any other waits for it."""
        import zenoh

        control, priority = zenoh.CongestionControl, zenoh.Priority
        return self._session.declare_publisher(
            self._keys.live(path),
            encoding=encoding,
            congestion_control=control.DROP if lossy else control.BLOCK,
            priority=priority.DATA if lossy else priority.INTERACTIVE_HIGH,
            express=False,  # else each message would take one of the 16 slots in a receiver's queue
        )


def _wanted(publisher: zenoh.Publisher) -> bool:
    """True if a consumer subscribes."""
    status: Any = publisher.matching_status  # Zenoh's stubs call it a bool
    return bool(status.matching)
