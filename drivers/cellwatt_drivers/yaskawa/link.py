"""One UDP conversation with a controller: one request in flight, answers matched by their number."""

from __future__ import annotations

import asyncio
import random
import socket
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Literal

from cellwatt.driver import Inlet
from cellwatt.errors import ConnectError, ProtocolError
from cellwatt.receipt import receive
from cellwatt_drivers.shared.datagrams import addresses, datagram_socket
from cellwatt_drivers.yaskawa import wire

_NUMBERS = 256
_QUARANTINE = 10.0
"""Time, s, for which the number of an unanswered request is not reused, so that its late answer cannot be mistaken
for another's."""

_BUSY_PAUSE = 0.005
"""Pause, s, before a request to a busy controller is repeated."""

Reason = Literal["timeout", "refused", "unreachable", "busy", "malformed", "device error"]
"""Reason for a failed poll, as counted in the account."""


class UnansweredError(Exception):
    """A request got no usable answer; ``reason`` as counted in the account."""

    def __init__(self, reason: Reason, text: str) -> None:
        super().__init__(text)
        self.reason: Reason = reason


@dataclass(frozen=True, slots=True)
class Exchange:
    """An answer with the cell's times (ns) of its request and of its arrival."""

    answer: wire.Answer
    asked: int
    arrival: int


TakeLate = Callable[[Exchange], None]
"""Takes a good answer that arrived after its time-out."""


@dataclass(frozen=True, slots=True)
class _Unanswered:
    """A request that timed out at ``since``, s of the loop; its answer may still arrive."""

    since: float
    asked: int
    service: int
    take: TakeLate | None


@asynccontextmanager
async def open_link(host: str, port: int, timeout: float, inlet: Inlet) -> AsyncIterator[Link]:
    """A link to the controller at ``host``; raises ``ConnectError`` if the name or the network is unknown."""
    loop = asyncio.get_running_loop()
    family, *_, address = (await addresses(host, port))[0]
    with datagram_socket(family) as connection:
        try:
            connection.connect(address)
        except OSError as error:
            raise ConnectError(f"{host}:{port} cannot be reached: {error.strerror or error}") from error
        link = Link(connection, f"{host}:{port}", timeout, inlet)
        loop.add_reader(connection, link.readable)
        try:
            yield link
        finally:
            loop.remove_reader(connection)


class Link:
    """Sends requests over a connected, non-blocking UDP ``connection``; counts other datagrams in the inlet's account.

    ``timeout`` in s for each answer. ``malformed`` counts datagrams that are not of the protocol.
    """

    def __init__(self, connection: socket.socket, place: str, timeout: float, inlet: Inlet) -> None:
        self.place = place
        self.malformed = 0
        self._connection = connection
        self._timeout = timeout
        self._inlet = inlet
        self._loop = asyncio.get_running_loop()
        self._number = 0
        self._service = 0
        self._waiting: asyncio.Future[tuple[wire.Answer, int]] | None = None
        self._unanswered: dict[int, _Unanswered] = {}
        self._answered: dict[int, wire.Answer] = {}
        self._recent: deque[int] = deque(maxlen=_NUMBERS // 2)
        self._constants: bytes | None = None

    async def ask(
        self, request: wire.Request, retries: int, until: int | None = None, late: TakeLate | None = None
    ) -> Exchange:
        """Return the good answer to a request.

        Repeats the request after a time-out or a busy answer, at most ``retries`` times and not after the monotonic
        clock (ns) has passed ``until``. Raises ``UnansweredError`` with the last reason. An answer that arrives after
        its time-out goes to ``late``.
        """
        for remaining in range(retries, -1, -1):
            try:
                return await self._ask_once(request, late)
            except UnansweredError as failure:
                if remaining == 0 or failure.reason not in {"timeout", "busy"}:
                    raise
                if failure.reason == "busy":
                    await asyncio.sleep(_BUSY_PAUSE)
                if until is not None and time.monotonic_ns() >= until:
                    raise
                self._inlet.account.count("retries")
        raise AssertionError("unreachable")

    async def _ask_once(self, request: wire.Request, late: TakeLate | None) -> Exchange:
        number = self._next_number()
        self._service = request.service | wire.ANSWER
        waiting = self._waiting = self._loop.create_future()
        timer = self._loop.call_later(self._timeout, self._expire)
        asked = self._inlet.now()
        try:
            self._send(wire.encode_request(request, number))
            answer, arrival = await waiting
        except BaseException:
            self._unanswered[number] = _Unanswered(self._loop.time(), asked, self._service, late)
            raise
        finally:
            timer.cancel()
            self._waiting = None
        self._answered[number] = answer
        if answer.status:
            self._inlet.account.count("busy answers" if answer.busy else "device errors")
            raise UnansweredError("busy" if answer.busy else "device error", answer.text)
        return Exchange(answer, asked, max(asked, arrival))

    def readable(self) -> None:
        """Read one datagram; called by the loop."""
        try:
            datagram, _, waited = receive(self._connection, 2048)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._fail_socket(error)
            return
        arrival = self._inlet.now() - waited
        try:
            answer = wire.decode_answer(datagram)
        except ProtocolError:
            self.count_malformed()
            return
        waiting = self._waiting
        if waiting is None or waiting.done() or answer.number != self._number:
            self._discard(answer, arrival)
        elif answer.service != self._service or not self._as_ever(answer):
            self.count_malformed()
        else:
            waiting.set_result((answer, arrival))

    def _as_ever(self, answer: wire.Answer) -> bool:
        """True if the fields that a controller never changes equal those of its first answer."""
        if self._constants is None:
            self._constants = answer.constants
        return answer.constants == self._constants

    def _send(self, datagram: bytes) -> None:
        try:
            self._connection.send(datagram)
        except OSError as error:
            self._fail_socket(error)

    def _next_number(self) -> int:
        """Choose a random number, which an outsider cannot guess, but none for which an answer may still arrive."""
        now = self._loop.time()
        start = random.randrange(_NUMBERS)
        for step in range(_NUMBERS):
            self._number = (start + step) % _NUMBERS
            rests = self._unanswered.get(self._number)
            if self._number not in self._recent and (rests is None or now - rests.since >= _QUARANTINE):
                break
        self._recent.append(self._number)
        self._unanswered.pop(self._number, None)
        self._answered.pop(self._number, None)
        return self._number

    def _discard(self, answer: wire.Answer, arrival: int) -> None:
        given_up = self._unanswered.pop(answer.number, None)
        if given_up is not None:
            self._answered[answer.number] = answer
            self._inlet.account.anomaly("late answers")
            if given_up.take is not None and not answer.status and answer.service == given_up.service:
                given_up.take(Exchange(answer, given_up.asked, max(given_up.asked, arrival)))
        elif (before := self._accepted(answer.number)) is None:
            self._inlet.account.anomaly("unasked answers")
        elif before == answer:
            self._inlet.account.anomaly("duplicates")
        else:
            # One of the two came from another sender; which one is unknown.
            self._inlet.account.forgery("contradicting answers")

    def _accepted(self, number: int) -> wire.Answer | None:
        """The answer accepted for the newest request with a number."""
        waiting = self._waiting
        if number == self._number and waiting is not None and waiting.done():
            return None if waiting.cancelled() or waiting.exception() else waiting.result()[0]
        return self._answered.get(number)

    def count_malformed(self) -> None:
        """Count a datagram that is not of the protocol, or not the requested answer."""
        self.malformed += 1
        self._inlet.account.anomaly("malformed")

    def _expire(self) -> None:
        self._inlet.account.count("timeouts")
        self._fail(UnansweredError("timeout", f"no answer within {self._timeout * 1e3:g} ms"))

    def _fail_socket(self, error: OSError) -> None:
        reason: Reason = "refused" if isinstance(error, ConnectionRefusedError) else "unreachable"
        self._inlet.account.count(reason)
        self._fail(UnansweredError(reason, error.strerror or str(error)))

    def _fail(self, failure: UnansweredError) -> None:
        if self._waiting is not None and not self._waiting.done():
            self._waiting.set_exception(failure)
