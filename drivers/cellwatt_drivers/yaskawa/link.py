"""One UDP conversation with a controller: one request in flight, answers matched by their number."""

from __future__ import annotations

import asyncio
import random
import socket
import time
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


@dataclass(eq=False, slots=True)
class _Sent:
    """A request sent at ``since``, s of the loop, and ``asked``, ns of the cell's time; its answer has this service.

    ``arrival`` is done when it is answered or given up; given up, its answer may still arrive, and goes to ``late``.
    """

    since: float
    asked: int
    service: int
    late: TakeLate | None
    arrival: asyncio.Future[int]
    answer: wire.Answer | None = None


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
        self._sent: dict[int, _Sent] = {}
        """Newest request of each number, in the order in which they were sent."""
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
        arrival: asyncio.Future[int] = self._loop.create_future()
        sent = _Sent(self._loop.time(), self._inlet.now(), request.service | wire.ANSWER, late, arrival)
        self._sent.pop(number, None)
        self._sent[number] = sent
        timer = self._loop.call_later(self._timeout, self._expire)
        try:
            self._send(wire.encode_request(request, number))
            await arrival
        finally:
            timer.cancel()
        answer = sent.answer
        assert answer is not None
        if answer.status:
            self._inlet.account.count("busy answers" if answer.busy else "device errors")
            raise UnansweredError("busy" if answer.busy else "device error", answer.text)
        return Exchange(answer, sent.asked, max(sent.asked, arrival.result()))

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
        sent, account = self._sent.get(answer.number), self._inlet.account
        if sent is None:
            account.anomaly("unasked answers")
        elif sent.answer == answer:
            account.anomaly("duplicates")
        elif sent.answer is not None:
            # One of the two came from another sender; which one is unknown.
            account.forgery("contradicting answers")
        elif sent.arrival.done():
            sent.answer = answer
            account.anomaly("late answers")
            if sent.late is not None and not answer.status and answer.service == sent.service:
                sent.late(Exchange(answer, sent.asked, max(sent.asked, arrival)))
        elif answer.service != sent.service or not self._as_ever(answer):
            self.count_malformed()
        else:
            sent.answer = answer
            sent.arrival.set_result(arrival)

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
        now, start, recent = self._loop.time(), random.randrange(_NUMBERS), [*self._sent][-_NUMBERS // 2 :]
        for step in range(_NUMBERS):
            number = (start + step) % _NUMBERS
            before = self._sent.get(number)
            awaited = before is not None and before.answer is None and now - before.since < _QUARANTINE
            if number not in recent and not awaited:
                break
        return number

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
        for sent in self._sent.values():
            if not sent.arrival.done():
                sent.arrival.set_exception(failure)
