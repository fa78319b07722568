"""One connection to a broker, served by a thread of the MQTT library; nothing here blocks the event loop."""

from __future__ import annotations

import asyncio
import contextlib
import math
import socket
import ssl
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from typing import Any, Final

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from cellwatt.account import Account
from cellwatt.errors import OutletError, why
from cellwatt.outlets.mqtt.message import Message, Subscription
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.remote import trust, unreached

ANSWER: Final = 10.0
"""Longest time, s, to wait for any answer of the broker."""
WINDOW: Final = 64
"""Most messages in flight at a time."""
RECEIVED: Final = 1000
"""Most received messages that wait to be processed; further ones are dropped and counted."""
_WITH_WILL: Final = 4
"""Reason code of MQTT 5: Disconnect with Will Message."""
_CLOSED: Final = (
    "the broker closed the connection without a reason; if this repeats: does it require TLS (mqtts://), a "
    "certificate, or another version than MQTT 5?"
)
_BROKE: Final = (
    "it broke; if this repeats: does another client have the same client ID, do the access rules forbid a topic, or "
    "does the broker limit the size of messages?"
)
_FENCE: Final = "cellwatt/fence"
_TOO_LARGE: Final = ReasonCode(PacketTypes.DISCONNECT, identifier=149)
_HEAD: Final = 10
"""Most bytes of a packet beside topic and payload."""
_ADVICE: Final = {
    134: "; check user and password",
    135: "; check user and password",
    142: "; another client has the same client ID: set 'client'",
    149: "; raise the broker's limit, or publish fewer channels",
}
"""Advice by reason code: bad user name or password, not authorised, session taken over, packet too large."""

Answer = asyncio.Future[Sequence[ReasonCode]]
"""The broker's answer to one packet, cancelled if the connection is lost first."""


class LostError(OutletError):
    """The connection was lost."""


def tls_context(settings: MqttSettings) -> ssl.SSLContext | None:
    """TLS context according to the settings, or ``None`` without TLS. Reads files. Raises ``OutletError``."""
    if not settings.encrypted:
        return None
    context = trust(settings.ca)
    try:
        if settings.certificate is not None:
            context.load_cert_chain(settings.certificate, settings.key, password=lambda: b"")
    except (OSError, ValueError) as error:
        raise OutletError(f"certificate or key cannot be used: {error}") from None
    context.sslsocket_class = _Socket
    return context


class _Socket(ssl.SSLSocket):
    """A socket that closes if the handshake fails; the library would leave that to garbage collection."""

    def do_handshake(self, block: bool = False) -> None:
        try:
            super().do_handshake(block)
        except OSError:
            self.close()
            raise


class Link:
    """A connection with ``will`` as its will message; ``refused`` is called with the reason for each refused message.

    ``account`` counts received messages that are dropped, and refused subscriptions. Always call ``abort`` last.
    """

    def __init__(
        self,
        settings: MqttSettings,
        client: str,
        will: Message,
        tls: ssl.SSLContext | None,
        refused: Callable[[str], None],
        account: Account,
    ) -> None:
        self._settings, self._refused, self._account = settings, refused, account
        self._loop = asyncio.get_running_loop()
        self._taken: asyncio.Future[str] = self._loop.create_future()
        """Reason why the broker refuses the connection; empty if it accepts."""
        self._lost: asyncio.Future[str] = self._loop.create_future()
        """Reason why the connection was lost."""
        self._largest = math.inf
        """Largest packet that the broker accepts, bytes."""
        self._answers: dict[int, Answer] = {}
        self._received: asyncio.Queue[mqtt.MQTTMessage | None] = asyncio.Queue()
        """Received messages; ``None`` after the last one, when the connection is lost."""
        made = self._client = mqtt.Client(
            CallbackAPIVersion.VERSION2, client, protocol=mqtt.MQTTv5, reconnect_on_failure=False
        )
        password = settings.password
        made.username_pw_set(settings.user, None if password is None else password.get_secret_value())
        made.will_set(will.topic, will.payload, will.qos, will.retain)
        if tls is not None:
            made.tls_set_context(tls)
        made.on_connect, made.on_disconnect = self._on_loop(self._on_connect), self._on_loop(self._on_disconnect)
        made.on_message, made.on_publish = self._on_loop(self._on_message), self._on_loop(self._on_publish)
        made.on_subscribe = made.on_unsubscribe = self._on_loop(self._on_answer)

    async def open(self) -> None:
        """Connect. Raises ``OutletError`` with advice on what to check."""
        self._connecting = asyncio.ensure_future(asyncio.to_thread(self._connect))
        try:
            await asyncio.shield(self._connecting)
            async with asyncio.timeout(ANSWER):
                refusal = await self._taken
        except (OSError, ValueError) as error:
            refusal = reason(error, encrypted=self._settings.encrypted)
        if refusal:
            raise OutletError(f"{self._settings.broker}: {refusal}")

    def _connect(self) -> None:
        self._client.connect(self._settings.host, self._settings.port, round(self._settings.keep_alive))
        self._client.loop_start()

    async def subscribe(self, subscription: Subscription) -> None:
        """Subscribe to topics, without our own messages.

        If the broker forbids it: raises ``OutletError`` if the subscription is needed, else counts the refusal.
        """
        options = SubscribeOptions(qos=subscription.qos, noLocal=True)
        answer = self._asked(self._client.subscribe(subscription.filter, options=options))
        await self.arrive([answer])
        if any(code.is_failure for code in answer.result()):
            if subscription.needed:
                forbidden = f"the broker forbids the subscription to {subscription.filter}"
                raise OutletError(f"{self._settings.broker}: {forbidden}")
            self._account.count("subscriptions refused")

    async def messages(self) -> AsyncIterator[tuple[str, bytes, bool]]:
        """Topic, payload and retained flag of messages. Raises ``LostError`` when the connection is lost."""
        while (message := await self._received.get()) is not None:
            yield message.topic, bytes(message.payload), message.retain
        raise self._error(_BROKE)

    def publish(self, message: Message) -> Answer:
        """Send a message; the answer completes when the broker confirms it, with QoS 0 when it is sent.

        A message that is too large for the broker is refused here: the broker would end the connection.
        """
        if len(message.topic.encode()) + len(message.payload) + _HEAD > self._largest:
            self._refused(_words(_TOO_LARGE))
            answer: Answer = self._loop.create_future()
            answer.set_result([_TOO_LARGE])
            return answer
        return self._asked(self._client.publish(message.topic, message.payload, message.qos, message.retain))

    def fence(self) -> Answer:
        """Request an answer that arrives once the broker has received all earlier messages.

        The request ends a subscription that does not exist: brokers answer in order.
        """
        return self._asked(self._client.unsubscribe(_FENCE))

    async def arrive(self, answers: Sequence[Answer]) -> None:
        """Wait for all answers. Raises ``LostError``."""
        _, pending = await asyncio.wait(answers, timeout=ANSWER)
        if pending or any(answer.cancelled() for answer in answers):
            raise self._error(f"no answer within {ANSWER:g} s" if pending else _BROKE)

    async def close(self, *, with_will: bool) -> None:
        """End the connection; ``with_will``: the broker publishes the will nevertheless."""
        code = ReasonCode(PacketTypes.DISCONNECT, identifier=_WITH_WILL if with_will else 0)
        self._client.disconnect(reasoncode=code)
        await asyncio.wait([self._lost], timeout=1.0)

    async def abort(self) -> None:
        """Close the socket at once; messages in flight are lost."""
        # The connecting thread cannot be cancelled; it gives up by itself after seconds.
        await asyncio.gather(self._connecting, return_exceptions=True)
        found = self._client.socket()
        if isinstance(found, socket.socket):
            with contextlib.suppress(OSError):
                socket.socket.shutdown(found, socket.SHUT_RDWR)  # not the shutdown of TLS: the thread may be reading
        try:
            with contextlib.suppress(AttributeError):  # the library's thread may clear its own reference meanwhile
                await asyncio.to_thread(self._client.loop_stop)
        finally:
            self._client._reset_sockets()  # as the library does on garbage collection

    def _asked(self, asked: Iterable[Any]) -> Answer:
        """The future answer to a request of the library."""
        failed, mid = asked
        answer: Answer = self._loop.create_future()
        if failed or self._lost.done():
            answer.cancel()
        else:
            self._answers[mid] = answer
        return answer

    def _error(self, otherwise: str) -> LostError:
        why = self._lost.result() if self._lost.done() else otherwise
        return LostError(f"{self._settings.broker}: the connection was lost: {why}")

    # callbacks of the library ---------------------------------------------------------------------

    def _on_loop(self, work: Callable[..., None]) -> Any:
        """A callback for the library's thread that runs ``work`` on the event loop."""
        return lambda _client, _data, *about: self._loop.call_soon_threadsafe(work, *about)

    def _on_connect(self, _flags: mqtt.ConnectFlags, code: ReasonCode, properties: object) -> None:
        self._largest = getattr(properties, "MaximumPacketSize", math.inf)
        if not self._taken.done():
            self._taken.set_result(_reported(code) if code.is_failure else "")

    def _on_disconnect(self, flags: mqtt.DisconnectFlags, code: ReasonCode, _: object) -> None:
        if not self._lost.done():
            self._lost.set_result(_reported(code) if flags.is_disconnect_packet_from_server else _BROKE)
        if not self._taken.done():
            self._taken.set_result(_CLOSED)
        self._received.put_nowait(None)
        for answer in self._answers.values():
            answer.cancel()

    def _on_message(self, message: mqtt.MQTTMessage) -> None:
        if self._received.qsize() < RECEIVED:
            self._received.put_nowait(message)
        else:
            self._account.count("received messages dropped")

    def _on_publish(self, mid: int, code: ReasonCode, _: object) -> None:
        if code.is_failure:
            self._refused(_words(code))
        self._on_answer(mid, [code])

    def _on_answer(self, mid: int, codes: Sequence[ReasonCode], _: object = None) -> None:
        answer = self._answers.pop(mid, None)
        if answer is not None and not answer.done():
            answer.set_result(codes)


def reason(error: Exception, *, encrypted: bool) -> str:
    """Reason why there is no connection, as text."""
    text = str(error)
    if isinstance(error, TimeoutError) and not text:
        return f"no answer within {ANSWER:g} s: the broker hangs, is too busy, or the address is not a broker"
    if "timed out" in text:
        tls = "handshake" in text
        return "no answer to the TLS handshake: is this a port for TLS?" if tls else "no answer: is the host running?"
    if isinstance(error, ConnectionResetError | BrokenPipeError):
        return f"{why(error)}; is this port for {'TLS' if encrypted else 'connections without TLS'}?"
    return unreached(error) if isinstance(error, OSError) else text


def _reported(code: ReasonCode) -> str:
    return f"the broker reports: {_words(code)}{_ADVICE.get(code.value, '')}"


def _words(code: ReasonCode) -> str:
    return str(code).lower()
