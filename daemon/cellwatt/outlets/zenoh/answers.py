"""Answers the questions that consumers ask a running cell.

    @/status  @/config  @/schema  @/recordings                        one JSON answer each
    @/history?source=arm;stream=samples;session=…;first=…;count=…     recorded samples, one Arrow message
    @/history?stream=frame;session=…;first=…;count=…                  kept frames, one Arrow message
    @/results?kind=alarm;session=…;first=…;count=…                    results or events, one JSON list
    alarm/**?cleared=N                                                alarms active now and the last N cleared

A question about the past gets one bounded piece: ask again from its end. Its answer has the priority of the
question, and waits where there is a limit in bytes a second. If nothing is there, or the question is wrong, the answer
is a Zenoh error with ``{"error": text}``. Anyone who reaches the port may ask anything: no question ends the answering
thread, and large questions are not queued.
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
"""Questions that may wait; more are refused, and a consumer asks again."""
_PAST: Final = ("history", "results")
"""Questions whose answers may be large, and are many after a cut."""
STUCK: Final = 10.0
"""Time, s, that one question may take before health says that the answers are stuck."""


class Answers:
    """Serves the questions of one cell, in a thread of its own from ``start`` to ``stop``.

    ``health`` gives the answer to ``@/status``; ``count`` counts what went wrong, and
    answers about the past; ``seal`` signs the answers, where the cell signs. ``rate`` limits the answers about the
    past, in bytes a second; ``None`` does not.
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
        self._told: set[str] = set()
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
        """Declare the questions and begin to answer them."""
        self._turns = self._new_turns()
        self._thread = threading.Thread(target=self._serve, name="cellwatt zenoh answers", daemon=False)
        self._thread.start()
        session.declare_queryable(self._keys.question("*"), lambda q: self._enqueue(q, self._reply, self._past(q)))
        session.declare_queryable(self._keys.live(f"{ALARM}/**"), lambda q: self._enqueue(q, self._reply_alarms))

    def stop(self) -> None:
        """End the thread after what it works on now."""
        if self._thread is not None:
            self._turns.end()
            self._thread.join()
            self._thread = None

    def trouble(self) -> str | None:
        """Reason why questions are not answered now; ``None`` if they are."""
        since = self._busy_since
        if since is not None and time.monotonic() - since > STUCK:
            return f"the thread that answers questions has been stuck at one for {time.monotonic() - since:.0f} s"
        return None

    def about(self, name: str, asked: Mapping[str, str]) -> Answer:
        """Answer one question. Raises ``CellwattError`` if the question is wrong or nothing is there."""
        if name not in self._known:
            raise QuestionError(f"there is no question {short(name)}; there are: {', '.join(self._known)}")
        return self._known[name](asked)

    def alarms(self, asked: Mapping[str, str]) -> list[tuple[Mark, Alarm]]:
        """The last ``cleared`` alarms that were cleared, then all active ones."""
        return [*self._backlog.cleared(min(number_of(asked, "cleared", 0), MOST_RESULTS)), *self._backlog.active()]

    # Zenoh ------------------------------------------------------------------------------------------

    def _new_turns(self) -> Turns:
        return Turns(self._rate, _WAITING, lambda: self._count("answers held back"))

    def _past(self, query: zenoh.Query) -> bool:
        """True if a question may ask for much of the past."""
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
            except zenoh.ZError as error:  # who asked is gone
                self._count("answers lost")
                log.info("zenoh: an answer could not be given: %s", error)
            except Exception as error:
                self._failed("", error)
            finally:
                self._busy_since = None

    def _failed(self, what: str, error: Exception) -> None:
        """Count a failure that only a bug or a damaged record can cause; log each kind once."""
        self._count("questions failed")
        kind = f"{what.partition('?')[0]} {type(error).__name__}"
        if kind not in self._told and len(self._told) < _WAITING:
            self._told.add(kind)
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
        """Answer a question that is wrong with its error."""
        import zenoh

        try:
            yield
        except zenoh.ZError:
            raise
        except RepairingError:  # without an answer it is asked again; with one it would be given up
            self._count("questions left open: a recording is being repaired")
        except CellwattError as error:
            if isinstance(error, QuestionError) and not isinstance(error, NothingKeptError):
                self._count("questions refused: wrong")
            self._refuse(query, str(error))
        except Exception as error:
            # One question that meets a broken record must not end the answers to all others.
            self._failed(str(query.selector), error)
            self._refuse(query, f"{type(error).__name__}: {error}")

    def _reply_one(self, query: zenoh.Query, name: str) -> None:
        import zenoh

        with self._refusing(query):
            answer = self.about(name, parameters(str(query.parameters)))
            key = self._keys.question(name)
            if answer.path is not None and query.accepts_replies() == zenoh.ReplyKeyExpr.ANY:
                key = self._keys.backfill(answer.path)
            mark = b"" if answer.mark is None else answer.mark.encode(answer.payload)
            topic, asked = answer.path or f"@/{name}", str(query.parameters)
            attachment = self._seal.answer(topic, asked, mark, answer.payload) or None
            query.reply(key, answer.payload, encoding=answer.encoding, attachment=attachment)
            if name in _PAST:
                size = len(answer.payload)
                self._turns.spend(size, time.monotonic())
                self._count("answers about the past")
                self._count("bytes of the past", size)

    def _refuse(self, query: zenoh.Query, error: str) -> None:
        query.reply_err(encode_json(self._seal.refusal(str(query.parameters), error)), encoding=JSON)

    def _reply_alarms(self, query: zenoh.Query) -> None:
        with query, self._refusing(query):
            asked = str(query.parameters)
            for mark, alarm in self.alarms(parameters(asked)):
                payload = encode_item(alarm, mark)
                attachment = self._seal.answer(ALARM, asked, replace(mark, backfill=True).encode(payload), payload)
                # Zenoh by default keeps one reply a key: with its id each alarm has a key of its own.
                for key in (alarm_path(alarm.severity, alarm.kind, alarm.id), alarm_path(alarm.severity, alarm.kind)):
                    if query.key_expr.intersects(self._keys.live(key)):
                        query.reply(self._keys.live(key), payload, encoding=JSON, attachment=attachment)
                        break


def _size(query: zenoh.Query) -> int:
    """Bytes that a question keeps in memory while it waits."""
    return len(query.payload or b"") + len(query.attachment or b"") + len(str(query.parameters))
