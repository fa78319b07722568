"""Answers the questions that consumers ask a running cell.

    @/status  @/config  @/schema  @/recordings                        one JSON answer each
    @/history?source=arm;stream=samples;session=…;first=…;count=…     recorded samples, one Arrow message
    @/history?stream=frame;session=…;first=…;count=…                  stored frames, one Arrow message
    @/results?kind=alarm;session=…;first=…;count=…                    results or events, one JSON list
    alarm/**?cleared=N                                                alarms active now and the last N cleared
    alarm/**?none=1                                                   alarms active now; an error if there are none

A question about the past gets one bounded piece: ask again from its end. Its answer has the priority of the question,
and is delayed if answers have a limit in bytes per second. If the data is not stored, or the question is invalid, the
answer is a Zenoh error with ``{"error": text}``. Anyone who reaches the port may ask anything: no question ends the
answering thread, and large questions are not queued.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from cellwatt.errors import CellwattError, RepairingError
from cellwatt.outlet import CellView
from cellwatt.outlets.zenoh.answer_queue import MOST_RESULTS, Answer, Past, Turns, Work
from cellwatt.outlets.zenoh.backlog import Backlog
from cellwatt.outlets.zenoh.encode import JSON
from cellwatt.outlets.zenoh.keys import ALARM, CellKeys, alarm_path
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import encode_item, encode_json
from cellwatt.outlets.zenoh.questions import (
    LARGEST,
    NothingKeptError,
    QuestionError,
    number_of,
    parameters,
    short,
)
from cellwatt.outlets.zenoh.signing import MessageSigner
from cellwatt.results import Alarm

if TYPE_CHECKING:
    import zenoh

log = logging.getLogger(__name__)

_WAITING: Final = 64
"""Most waiting questions; further ones are refused, and the consumer asks again."""
_PAST: Final = ("history", "results")
"""Questions with large answers, and with many of them after an interruption."""
STUCK: Final = 10.0
"""Time, s, that one question may take before health reports that the thread is stuck."""


class Answers:
    """Answers the questions of one cell, in its own thread from ``start`` to ``stop``.

    ``health`` returns the answer to ``@/status``; ``count`` counts failures and answers about the past; ``seal`` signs
    the answers if the cell signs. ``rate`` limits the answers about the past, bytes per second; ``None``: no limit.
    """

    def __init__(
        self,
        view: CellView,
        keys: CellKeys,
        backlog: Backlog,
        count: Callable[..., None],
        health: Callable[[], Answer],
        seal: MessageSigner | None = None,
        rate: float | None = None,
    ) -> None:
        self._view = view
        self._keys = keys
        self._backlog = backlog
        self._count = count
        self._seal = seal or MessageSigner(keys.root, None)
        self._rate = rate
        self._turns = self._new_turns()
        self._thread: threading.Thread | None = None
        self._busy_since: float | None = None
        self._logged: set[str] = set()
        past = Past(view, backlog, lambda: self._turns.piece())

        self._known: dict[str, Callable[[Mapping[str, str]], Answer]] = {
            "status": lambda _: health(),
            "config": lambda _: Answer(encode_json(view.config())),
            "schema": lambda _: Answer(encode_json(view.schema())),
            "recordings": lambda _: Answer(encode_json(list(view.recordings()))),
            "history": past.history,
            "results": past.results,
        }

    def start(self, session: zenoh.Session) -> None:
        """Declare the queryables and begin to answer."""
        self._turns = self._new_turns()
        self._thread = threading.Thread(target=self._serve, name="cellwatt zenoh answers", daemon=False)
        self._thread.start()
        session.declare_queryable(self._keys.question("*"), lambda q: self._enqueue(q, self._reply, self._past(q)))
        session.declare_queryable(self._keys.live(f"{ALARM}/**"), lambda q: self._enqueue(q, self._reply_alarms))

    def stop(self) -> None:
        """End the thread after its current question."""
        if self._thread is not None:
            self._turns.end()
            self._thread.join()
            self._thread = None

    def trouble(self) -> str | None:
        """Reason why questions are not answered now, or ``None``."""
        since = self._busy_since
        if since is not None and time.monotonic() - since > STUCK:
            return f"the thread that answers questions has been stuck at one for {time.monotonic() - since:.0f} s"
        return None

    def about(self, name: str, asked: Mapping[str, str]) -> Answer:
        """Answer one question. Raises ``CellwattError`` if it is invalid or the data is not stored."""
        if name not in self._known:
            raise QuestionError(f"unknown question {short(name)}; known questions: {', '.join(self._known)}")
        return self._known[name](asked)

    def alarms(self, asked: Mapping[str, str]) -> list[tuple[Mark, Alarm]]:
        """The last ``cleared`` cleared alarms, then all active ones."""
        return [*self._backlog.cleared(min(number_of(asked, "cleared", 0), MOST_RESULTS)), *self._backlog.active()]

    # Zenoh ------------------------------------------------------------------------------------------

    def _new_turns(self) -> Turns:
        return Turns(self._rate, _WAITING, lambda: self._count("answers held back"))

    def _past(self, query: zenoh.Query) -> bool:
        """True if a question may request past data."""
        return any(query.key_expr.intersects(self._keys.question(name)) for name in _PAST)

    def _enqueue(self, query: zenoh.Query, reply: Callable[[zenoh.Query], None], past: bool = False) -> None:
        """Queue a question. Runs in Zenoh's thread, so it must not block."""
        reason = "too large" if _size(query) > LARGEST else None
        if reason is None and not self._turns.put(lambda: reply(query), past):
            reason = "too many wait"
        if reason is not None:
            self._count(f"questions refused: {reason}")
            query.drop()  # type: ignore[no-untyped-call]

    def _serve(self) -> None:
        import zenoh

        work: Work | None
        while (work := self._turns.take()) is not None:
            self._busy_since = time.monotonic()
            try:
                work()
            except zenoh.ZError as error:  # the questioner has disconnected
                self._count("answers lost")
                log.info("zenoh: an answer could not be sent: %s", error)
            except Exception as error:
                self._failed("", error)
            finally:
                self._busy_since = None

    def _failed(self, what: str, error: Exception) -> None:
        """Count a failure caused by a bug or a damaged record; log each kind once."""
        self._count("questions failed")
        kind = f"{what.partition('?')[0]} {type(error).__name__}"
        if kind not in self._logged and len(self._logged) < _WAITING:
            self._logged.add(kind)
            log.exception("zenoh: the question %s could not be answered", short(what, 200))

    def _reply(self, query: zenoh.Query) -> None:
        with query:
            names = [n for n in self._known if query.key_expr.intersects(self._keys.question(n))]
            alone = len(names) < 2
            for name in names or [str(query.key_expr).rsplit("/", 1)[-1]]:
                if alone or name not in _PAST:
                    self._reply_one(query, name)

    @contextmanager
    def _refusing(self, query: zenoh.Query) -> Iterator[None]:
        """Answer a question that fails with the error."""
        import zenoh

        try:
            yield
        except zenoh.ZError:
            raise
        except RepairingError:  # no answer: the consumer asks again; after an error it would give up
            self._count("questions left open: a recording is being repaired")
        except CellwattError as error:
            if isinstance(error, QuestionError) and not isinstance(error, NothingKeptError):
                self._count("questions refused: wrong")
            self._refuse(query, str(error))
        except Exception as error:
            # A question that meets a broken record must not end the answers to all others.
            self._failed(str(query.selector), error)
            self._refuse(query, f"{type(error).__name__}: {error}")

    def _reply_one(self, query: zenoh.Query, name: str) -> None:
        with self._refusing(query):
            answer = self.about(name, parameters(str(query.parameters)))
            mark = b"" if answer.mark is None else answer.mark.encode(answer.payload)
            topic, asked = answer.path or f"@/{name}", str(query.parameters)
            attachment = self._seal.answer(topic, asked, mark, answer.payload) or None
            query.reply(self._keys.question(name), answer.payload, encoding=answer.encoding, attachment=attachment)
            if name in _PAST:
                size = len(answer.payload)
                self._turns.spend(size, time.monotonic())
                self._count("answers about the past")
                self._count("bytes of the past", size)

    def _refuse(self, query: zenoh.Query, error: str) -> None:
        query.reply_err(encode_json(self._seal.refusal(str(query.parameters), error)), encoding=JSON)

    def _reply_alarms(self, query: zenoh.Query) -> None:
        with query, self._refusing(query):
            asked, found = str(query.parameters), 0
            for mark, alarm in self.alarms(parameters(asked)):
                payload = encode_item(alarm, mark)
                attachment = self._seal.answer(ALARM, asked, replace(mark, backfill=True).encode(payload), payload)
                # By default Zenoh delivers one reply per key: the id gives each alarm its own key.
                for key in (alarm_path(alarm.severity, alarm.kind, alarm.id), alarm_path(alarm.severity, alarm.kind)):
                    if query.key_expr.intersects(self._keys.live(key)):
                        query.reply(self._keys.live(key), payload, encoding=JSON, attachment=attachment)
                        found += 1
                        break
            if not found and "none" in parameters(asked):
                raise NothingKeptError("no alarm is active")


def _size(query: zenoh.Query) -> int:
    """Bytes of memory that a waiting question takes."""
    return len(query.payload or b"") + len(query.attachment or b"") + len(str(query.parameters))
