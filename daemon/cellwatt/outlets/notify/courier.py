"""Sends one recipient its messages in order, and retries after failures."""

from __future__ import annotations

import asyncio
import logging
import random
import time
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from cellwatt.account import Account
from cellwatt.errors import why
from cellwatt.files import put_aside
from cellwatt.outlets.notify.channels import Channel, cleaned
from cellwatt.outlets.notify.ledger import Ledger
from cellwatt.outlets.notify.quiet import passing
from cellwatt.outlets.notify.rules import Item, Notification, Rules, message_of, ready, silence
from cellwatt.outlets.notify.settings import MailSettings, NotifySettings, RecipientSettings, recipient_of
from cellwatt.outlets.notify.texts import About, undelivered
from cellwatt.outlets.remote import NotNowError, RefusedError
from cellwatt.results import Alarm

log = logging.getLogger(__name__)

UNDELIVERED: Final = "notify-undelivered.jsonl"
"""File of the messages that were not delivered, with the reasons, beside the recordings."""
LARGEST: Final = 1_000_000
"""Largest size of that file, bytes."""
LONGEST_PAUSE: Final = 600.0
"""Longest pause between two attempts, s."""
GRACE: Final = 3.0
"""Time, s, in which an attempt may still complete when the outlet ends, so that an acceptance is stored."""
FAILING: Final = 60.0
"""Time, s, for which attempts may fail before health reports it: mail servers defer unknown senders (greylisting)."""
LOOK: Final = 0.25
"""Time between two checks of the clock, s, while an item or an alarm depends on it."""


@dataclass(slots=True)
class _Trouble:
    reason: str
    since: float  # monotonic s
    final: bool


class Courier:
    """One entry ``to`` of ``NotifySettings.each`` at run time; ``ledger`` has its state, ``folder`` its undelivered
    messages."""

    def __init__(
        self,
        name: str,
        to: RecipientSettings,
        settings: NotifySettings,
        about: About,
        session: int,
        ledger: Ledger,
        account: Account,
        folder: Path | None,
    ) -> None:
        self.name = name
        self._settings, self._to = settings, to
        self._about, self._session, self._ledger, self._account = about, session, ledger, account
        self._folder = folder
        self._state = ledger.of(name)
        self._rules = Rules(to.severity, to.kinds, to.resolved, settings.queue)
        self._born = dict.fromkeys(self._state.due, time.monotonic())
        """Time at which each item began to wait, monotonic s."""
        self._last = dict.fromkeys(self._state.episodes, time.monotonic())
        """Time at which each alarm was last sent, monotonic s."""
        self._made: float | None = None
        """Time at which the current message was made, monotonic s; ``None`` if an earlier start made it."""
        self._open: Collection[str] = ()
        self._wake = asyncio.Event()
        self._trouble: _Trouble | None = None

    # incoming alarms--------------------------------------------------------------------------------

    def take(self, alarm: Alarm) -> None:
        """Process a message of the alarm book."""
        self._rules.take(self._state, alarm, self._session, self._passing())
        self._note()

    def heed(self, unattended: Collection[str], shelved: Collection[str]) -> None:
        """Set the active, unacknowledged alarms, which may be repeated; discard the waiting items of shelved ones."""
        self._open = unattended
        for alarm_id in shelved:  # after a restart nothing is published of an alarm that is raised again on its shelf
            episode = self._state.episodes.get(alarm_id)
            if episode is not None and episode.session != self._session:
                self._state.see(episode.alarm, self._session)
        repeated = [alarm_id for (alarm_id, _), item in self._state.due.items() if item.what == "repeated"]
        for alarm_id in (*shelved, *(known for known in repeated if known not in unattended)):
            silence(self._state, alarm_id)
        self._note()

    def _note(self) -> None:
        """Move the recipient's counts to the account, and wake the sender after a change."""
        state, now = self._state, time.monotonic()
        while state.counts:
            self._count(*state.counts.popitem())
        self._born = {slot: self._born.get(slot, now) for slot in state.due}
        if state.changed:
            self._wake.set()

    def _passing(self) -> int:
        return passing(self._to.quiet, datetime.now(UTC), self._settings.zone)

    def _count(self, what: str, number: int = 1) -> None:
        self._account.count(f"{recipient_of(self.name)}: {what}", number)

    # outgoing messages--------------------------------------------------------------------------------

    def trouble(self) -> str | None:
        """Reason why this recipient is not reached, in one line, or ``None``."""
        trouble = self._trouble
        if trouble is None or not (trouble.final or time.monotonic() - trouble.since >= FAILING):
            return None
        return f"{self.name} cannot be reached ({self._to.place}): {trouble.reason}"

    async def run(self) -> None:
        """Send messages until cancelled."""
        channel = await asyncio.to_thread(channel_to, self._to, self._about, self._settings.timeout)
        while True:
            self._wake.clear()
            self._look()
            await self._ledger.flush()
            if self._state.flight is not None:
                await self._deliver(channel, self._state.flight)
                continue
            try:
                async with asyncio.timeout(LOOK if self._state.due or self._state.episodes else None):
                    await self._wake.wait()
            except TimeoutError:
                pass

    def _look(self) -> None:
        """Withdraw alarms, repeat alarms and make the next message, as the clock requires."""
        state, now, allowed = self._state, time.monotonic(), self._passing()
        self._rules.withdraw(state, self._session, time.time_ns())
        if self._to.repeat is not None:
            due = [i for i in self._open if now - self._last.setdefault(i, now) >= self._to.repeat]
            self._rules.again(state, due, self._session)
        self._note()
        if state.flight is None and (items := self._grouped(now, allowed)):
            to = f"{self._about.site}/{self._about.cell}/{self.name}"
            state.send(message_of(to, items, state.more, time.time_ns()))
            self._made = now
            self._last |= dict.fromkeys((item.alarm.id for item in items), now)
            self._last = {alarm: at for alarm, at in self._last.items() if alarm in state.episodes}
            self._count("grouped", len(items) - 1)

    def _grouped(self, now: float, allowed: int) -> list[Item]:
        """Items of the next message; none while more items may join its group."""
        items = ready(self._state, allowed)
        oldest = min((self._born.get(item.slot, now) for item in items), default=now)
        return items if now - oldest >= self._to.group else []

    async def _deliver(self, channel: Channel, message: Notification) -> None:
        """Try to send a message until it is accepted, refused, or too old."""
        pause = self._settings.retry
        while (failure := await self._attempt(channel, message)) is not None:
            # By the PC's clock, which may be set meanwhile, only after a restart.
            age = (time.time_ns() - message.made) / 1e9 if self._made is None else time.monotonic() - self._made
            if age > self._settings.give_up:
                await self._give_up(message, f"given up after {age / 3600:.1f} h: {failure}")
                return
            self._count("retried")
            await asyncio.sleep(max(failure.wait or 0.0, pause * random.uniform(0.5, 1.0)))
            pause = min(2 * pause, max(LONGEST_PAUSE, self._settings.retry))

    async def _attempt(self, channel: Channel, message: Notification) -> NotNowError | None:
        """Try once; return the reason to try again, or ``None``."""
        work = asyncio.create_task(channel.send(message))
        try:
            try:
                await asyncio.shield(work)
            except asyncio.CancelledError:
                with suppress(Exception):
                    async with asyncio.timeout(GRACE):
                        await work
                        await self._accepted()
                raise
            await self._accepted()
        except RefusedError as error:
            await self._give_up(message, self._clean(error))
        except NotNowError as error:
            return self._failed(NotNowError(self._clean(error), error.wait))
        except Exception as error:
            log.exception("notify: %s: sending failed", self.name)
            return self._failed(NotNowError(f"sending failed: {type(error).__name__}, see the log"))
        return None

    async def _accepted(self) -> None:
        self._state.arrived()
        await self._ledger.flush()
        self._trouble = None
        self._count("sent")

    def _failed(self, error: NotNowError) -> NotNowError:
        if self._trouble is None:
            self._trouble = _Trouble(str(error), time.monotonic(), final=False)
            log.warning("notify: %s: %s; trying again", self.name, error)
        self._trouble.reason = str(error)
        return error

    async def _give_up(self, message: Notification, reason: str) -> None:
        log.warning("notify: a message to %s was not delivered: %s", self.name, reason)
        self._trouble = _Trouble(reason, time.monotonic(), final=True)
        await self._store_undelivered(message, reason)
        self._state.arrived()
        await self._ledger.flush()

    async def _store_undelivered(self, message: Notification, reason: str) -> None:
        """Append a message to the file of undelivered messages."""
        if self._folder is not None:
            path, now = self._folder / UNDELIVERED, datetime.now(UTC).isoformat(timespec="seconds")
            content = undelivered(self._about, self.name, message, reason, now)
            try:
                if await asyncio.to_thread(put_aside, path, content, LARGEST):
                    self._account.count("undelivered: older files thrown away")
            except OSError as error:
                self._account.count("undelivered: not written")
                log.warning("notify: %s cannot be written: %s", path, why(error))
        self._count("undelivered")

    def _clean(self, reason: Exception | str) -> str:
        return cleaned(str(reason), self._to.secrets)


def channel_to(to: RecipientSettings, about: About, timeout: float) -> Channel:
    """Make the channel of a recipient; one attempt takes at most ``timeout`` s."""
    settings = to.channel
    if isinstance(settings, MailSettings):
        from cellwatt.outlets.notify.mail import Mail

        return Mail(settings, about, timeout)
    from cellwatt.outlets.notify.web import WebChannel

    return WebChannel(settings, about, timeout)
