"""The thread in which a subscriber asks its cell for missing messages."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Final

from cellwatt.errors import OutletError
from cellwatt.outlets.zenoh.keys import ALARM, CellKeys
from cellwatt.subscriber.inbox import Inbox

if TYPE_CHECKING:
    import zenoh

_TICK: Final = 0.05  # s, between two looks at what is missing
_TIMEOUT: Final = 5.0  # s, for the answer to one question


class Asker:
    """Asks the cell for everything that ``inbox`` lacks, from ``start`` to ``stop``; answers go to ``inbox``."""

    def __init__(self, session: zenoh.Session, keys: CellKeys, inbox: Inbox) -> None:
        self._session = session
        self._keys = keys
        self._inbox = inbox
        self._standing_asked = inbox.following.joined
        self._stopped = threading.Event()
        # No daemon thread: the threads in which Zenoh calls back inherit that, and one of them inside Zenoh
        # while the interpreter ends aborts the process.
        self._thread = threading.Thread(target=self._work, name="cellwatt subscriber", daemon=False)

    def start(self) -> None:
        """Begin to ask."""
        self._inbox.look.set()
        self._thread.start()

    def stop(self) -> None:
        """Wait until no more is asked."""
        self._stopped.set()
        self._inbox.look.set()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        import zenoh

        inbox = self._inbox
        try:
            while not self._stopped.is_set():
                inbox.look.wait(_TICK)
                inbox.look.clear()
                if not inbox.mailbox.full:
                    self._ask_what_is_missing()
        except zenoh.ZError as error:
            inbox.mailbox.end(OutletError(f"Zenoh session: {error}"))
        except BaseException as error:
            inbox.mailbox.end(error)
            raise

    def _ask_what_is_missing(self) -> None:
        inbox, now = self._inbox, time.monotonic()
        with inbox.lock:
            following = inbox.following
            if telling := following.asks_told(now):
                inbox.status_is_asked()
            questions = following.questions(now)
            standing = following.joined and not self._standing_asked and following.wants(ALARM)
            self._standing_asked |= standing
            sessions = following.asks_sessions(now)
        if telling:
            self._ask(self._keys.question("status"), "@/status", inbox.on_status)
        if sessions:
            self._ask(self._keys.question("recordings"), "@/recordings", inbox.on_recordings)
        if standing:
            self._ask(self._keys.live(f"{ALARM}/**"), ALARM, inbox.on_standing)
        for question in questions:
            self._ask(question.selector(self._keys), question.topic, partial(inbox.on_answer, question))

    def _ask(self, selector: str, topic: str, then: Callable[[list[zenoh.Reply]], None]) -> None:
        """Ask about a topic; call ``then`` with the replies once all have arrived."""
        import zenoh

        replies: list[zenoh.Reply] = []
        witness = self._inbox.witness
        if witness.asks_for_proof:  # so that no older answer can be passed off as this one
            selector += f"{';' if '?' in selector else '?'}nonce={secrets.token_hex(8)}"

        def done() -> None:
            with self._inbox.guarded():
                then([reply for reply in replies if witness.reply(topic, selector, reply)])
            self._inbox.look.set()

        self._session.get(
            selector,
            zenoh.handlers.Callback(replies.append, done),
            timeout=_TIMEOUT,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            consolidation=zenoh.ConsolidationMode.NONE,
            priority=zenoh.Priority.DATA_LOW,
        )
