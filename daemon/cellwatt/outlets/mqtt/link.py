"""One connection to a broker: opened, used and closed without ever holding up the event loop.

aiomqtt leaves the socket of a connection open that was never answered, or whose end is not acknowledged, until the
keep-alive ends it; here it is closed at once.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import socket
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any, Final, TypeVar

import aiomqtt
import paho.mqtt.client as mqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from cellwatt.errors import OutletError, why
from cellwatt.outlets.mqtt.message import Message, Subscription
from cellwatt.outlets.mqtt.settings import MqttSettings

log = logging.getLogger(__name__)

ANSWER: Final = 10.0
"""Longest time, s, that the broker may take to answer anything."""
WINDOW: Final = 64
"""Messages that may be on their way at a time."""
_HEARD: Final = 1000
"""Messages from the broker that may wait for us; more are dropped by the library, which logs it."""
_WITH_WILL: Final = 4
"""Reason code of MQTT 5: Disconnect with Will Message."""
_CLOSED: Final = (
    "the broker closed the connection without a word; if it goes on so: does it want a certificate, or speak another "
    "version than MQTT 5?"
)
_LATE: Final = "Operation timed out"
"""What the library says where the broker gives no answer on a connection that it took."""
_ERRNO = re.compile(r"^\[Errno -?\d+\] ")
_FENCE: Final = "cellwatt/fence"
_REFUSED: Final = 0x80
"""Least reason code of a refusal."""
_AUTHENTICATION: Final = (134, 135)
"""Reason codes: bad user name or password, not authorised."""
_library = logging.getLogger("cellwatt.mqtt")
_library.disabled = True
T = TypeVar("T")


def tls_context(settings: MqttSettings) -> ssl.SSLContext | None:
    """TLS as the settings want it; ``None`` for none. Reads files. Raises ``OutletError``."""
    if not settings.encrypted:
        return None
    try:
        context = ssl.create_default_context(cafile=settings.ca)
        if settings.certificate is not None:
            context.load_cert_chain(settings.certificate, settings.key, password=lambda: b"")
    except (OSError, ValueError) as error:
        raise OutletError(f"ca, certificate or key cannot be used: {error}") from None
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.sslsocket_class = _Socket
    return context


class _Socket(ssl.SSLSocket):
    """Closed where the handshake fails, which the library leaves to chance."""

    def do_handshake(self, block: bool = False) -> None:
        try:
            super().do_handshake(block)
        except OSError:
            self.close()
            raise


class _Client(aiomqtt.Client):
    """Looks at the socket when it begins to write, not before: it may be closed by then, and its number another's.

    ``refused`` is told why the broker does not take a message, which the library passes over. A cancellation always
    comes through: ``asyncio.wait_for`` of Python 3.11 loses the one that comes together with the broker's answer.
    """

    async def _wait_for(self, fut: Awaitable[T], timeout: float | None) -> T:
        try:
            async with asyncio.timeout(self.timeout if timeout is None else timeout):
                return await fut
        except TimeoutError:
            raise aiomqtt.MqttError(_LATE) from None

    def _on_socket_register_write(self, client: mqtt.Client, userdata: Any, sock: Any) -> None:
        def write() -> None:
            try:
                client.loop_write()
            except OSError as error:
                if not self._disconnected.done():
                    self._disconnected.set_exception(error)

        def begin() -> None:
            if (found := client.socket()) is not None and found is sock:
                self._loop.add_writer(found.fileno(), write)

        self._loop.call_soon_threadsafe(begin)

    refused: Callable[[str], None]

    def _on_publish(
        self, client: mqtt.Client, userdata: Any, mid: int, reason_code: ReasonCode, properties: Properties
    ) -> None:
        if reason_code.is_failure:
            self.refused(str(reason_code).lower())
        super()._on_publish(client, userdata, mid, reason_code, properties)


class Link:
    """A connection that publishes ``will`` if it is lost; ``refused`` is called with the broker's reasons."""

    def __init__(
        self,
        settings: MqttSettings,
        client: str,
        will: Message,
        tls: ssl.SSLContext | None,
        refused: Callable[[str], None],
    ) -> None:
        self._broker = settings.broker
        password = settings.password
        self._client = _Client(
            settings.host,
            settings.port,
            identifier=client,
            username=settings.user,
            password=None if password is None else password.get_secret_value(),
            protocol=aiomqtt.ProtocolVersion.V5,
            will=aiomqtt.Will(will.topic, will.payload, will.qos, will.retain),
            keepalive=round(settings.keep_alive),
            timeout=ANSWER,
            max_queued_incoming_messages=_HEARD,
            tls_context=tls,
            logger=_library,
        )
        self._client.refused = refused
        self._client.pending_calls_threshold = 2 * WINDOW

    async def open(self) -> None:
        """Connect. Raises ``OutletError`` that says what to check."""
        connecting = asyncio.ensure_future(self._client.__aenter__())
        try:
            await asyncio.shield(connecting)
        except (aiomqtt.MqttError, OSError, ValueError) as error:
            closed = str(error) == _LATE and self._client._client.socket() is None
            await self.abort()
            raise OutletError(f"{self._broker}: {_CLOSED if closed else reason(error)}") from None
        except asyncio.CancelledError:
            # Its thread cannot be cancelled; it gives up by itself, after seconds.
            connecting.cancel()
            with contextlib.suppress(asyncio.CancelledError, aiomqtt.MqttError, OSError, ValueError):
                await connecting
            await self.abort()
            raise

    async def subscribe(self, subscription: Subscription) -> None:
        """Listen to topics, not to our own messages. Raises ``OutletError`` where the broker forbids it."""
        options = SubscribeOptions(qos=subscription.qos, noLocal=True)
        codes = await self._client.subscribe(subscription.filter, options=options)
        if any(_number(code) >= _REFUSED for code in codes):
            raise OutletError(f"{self._broker}: the broker does not let us subscribe to {subscription.filter}")

    async def messages(self) -> AsyncIterator[tuple[str, bytes, bool]]:
        """Topic, payload and retained flag of messages. Raises ``MqttError`` when the connection is lost."""
        async for message in self._client.messages:
            payload = message.payload
            yield str(message.topic), payload if isinstance(payload, bytes) else b"", bool(message.retain)

    async def publish(self, message: Message) -> None:
        """Send a message, and wait for the broker's word on it where its quality of service has one.

        Raises ``MqttError``.
        """
        await self._client.publish(message.topic, message.payload, message.qos, message.retain)

    async def fence(self) -> None:
        """Return when the broker has taken all that was sent before. Raises ``MqttError``.

        It answers in order, also the end of a subscription that there is not.
        """
        await self._client.unsubscribe(_FENCE)

    async def close(self, *, with_will: bool) -> None:
        """End the connection; ``with_will``: the broker then publishes the will all the same."""
        code = ReasonCode(PacketTypes.DISCONNECT, identifier=_WITH_WILL if with_will else 0)
        library = self._client._client
        if library.socket() is not None:
            library.disconnect(reasoncode=code)
            with contextlib.suppress(aiomqtt.MqttError):
                await asyncio.wait([asyncio.ensure_future(self._over())], timeout=1.0)
        await self.abort()

    async def _over(self) -> None:
        while self._client._client.socket() is not None:  # noqa: ASYNC110 (the library tells nobody of it)
            await asyncio.sleep(0.005)

    async def abort(self) -> None:
        """Close the socket at once, whatever is on its way."""
        client, library = self._client, self._client._client
        if isinstance(found := library.socket(), socket.socket):
            with contextlib.suppress(OSError):
                found.shutdown(socket.SHUT_RDWR)
            for _ in range(_HEARD):  # what came before the end, and then the end, at which it closes
                if library.loop_read() != mqtt.MQTT_ERR_SUCCESS:
                    break
        if (task := client._misc_task) is not None:
            task.cancel()
            await asyncio.wait([task])
        if client._disconnected.done() and not client._disconnected.cancelled():
            client._disconnected.exception()


def reason(error: Exception) -> str:
    """An error of the connection in plain words."""
    if isinstance(error, aiomqtt.MqttCodeError) and isinstance(error.rc, ReasonCode):
        advice = "; check user and password" if _number(error.rc) in _AUTHENTICATION else ""
        return f"the broker says: {str(error.rc).lower()}{advice}"
    if isinstance(error, ssl.SSLError):
        return f"TLS failed: {error.reason or error}; check ca, certificate and the broker's name"
    if isinstance(error, OSError):
        return why(error)
    text = _ERRNO.sub("", str(error.__cause__ or error))
    if text == _LATE:
        return f"no answer within {ANSWER:g} s: the broker hangs or is too busy, or it is none"
    if "timed out" in text.lower():
        tls = "handshake" in text.lower()
        return "no answer to the TLS handshake: is this a port for TLS?" if tls else "nobody answers: is the host up?"
    if "certificate" in text.lower() or "ssl" in text.lower():
        return f"TLS failed: {text}; check ca, certificate and the broker's name"
    return text


def _number(code: int | ReasonCode) -> int:
    return int(code.value) if isinstance(code, ReasonCode) else int(code)
