"""Subscribes to the meter's topic and hands over what it publishes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import aiomqtt
import numpy as np
from pydantic import Field, SecretStr

from cellwatt import ConnectError, Driver, Identity, Inlet, ProtocolError, Reading, SourceSettings, Stream
from cellwatt.quantity import Hertz, Seconds
from mqtt_meter import payload

MOST_WAITING = 1000
"""Messages that may wait for the loop; beyond it the library drops the newest and says so in its log."""


class MqttMeterSettings(SourceSettings):
    """A meter that publishes JSON to a topic of an MQTT broker."""

    host: str
    """Address of the broker."""
    port: int = Field(1883, ge=1, le=65535)
    """TCP port of the broker."""
    topic: str = Field("shellypro3em/status/em:0", min_length=1, pattern=r"^[^#+]+$")
    """Topic of this meter, without wildcards."""
    fields: tuple[payload.Field, ...] = Field(payload.FIELDS, min_length=1)
    """What to take from each message."""
    rate: Hertz = 1.0
    """Messages a second that the meter publishes; what is missing is seen against it."""
    user: str | None = None
    """User name at the broker."""
    password: SecretStr | None = None
    """Password at the broker: ${NAME} takes it from the environment."""
    silence: Seconds = Field(10.0, gt=0)
    """Without a message for this time the connection is made anew."""
    timeout: Seconds = Field(5.0, gt=0)
    """Longest time to connect."""


class MqttMeterDriver(Driver[MqttMeterSettings]):
    """One topic. Every message is one sample, stamped when it arrives."""

    Settings = MqttMeterSettings
    title = "Power meters that publish JSON over MQTT (Shelly Pro 3EM)"
    emulator = "mqtt_meter.emulator:MqttMeterEmulator"
    writes = ("to the broker: CONNECT, SUBSCRIBE, PINGREQ, DISCONNECT; nothing is ever published",)

    def __init__(self, name: str, settings: MqttMeterSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        channels = tuple(payload.CHANNELS[f] for f in settings.fields)
        self._stream = Stream("measured", channels, settings.rate, "host")
        self._heard: int | None = None
        """When the last sample came, ns; kept over a lost connection, so that the gap is counted."""

    @property
    def streams(self) -> tuple[Stream, ...]:
        """One: ``measured``."""
        return (self._stream,)

    async def identify(self) -> Identity:
        """See ``Driver.identify``; waits for the first message."""
        async with self._subscribed() as client:
            while True:
                message = await self._next(client)
                payload.parse(_bytes(message), self.settings.fields)
                return self._identity()

    async def run(self) -> None:
        """See ``Driver.run``."""
        async with self._subscribed() as client:
            self.inlet.connected(self._identity())
            while True:
                self._take(await self._next(client))

    def _take(self, message: aiomqtt.Message) -> None:
        arrival = self.inlet.now()
        if message.retain:
            self.inlet.account.count("retained")
            return
        self._count_gap(arrival)
        self.inlet.account.expect()
        try:
            values = payload.parse(_bytes(message), self.settings.fields)
        except ProtocolError as error:
            self.inlet.account.drop(1, "malformed")
            self.inlet.event("malformed", f"{self.name}: {error}")
            return
        self.inlet.emit(Reading(self._stream, np.array([values]), arrival))

    def _count_gap(self, arrival: int) -> None:
        """Miss the messages that should have come since the last one."""
        periods = 1 if self._heard is None else round((arrival - self._heard) * self.settings.rate / 1e9)
        self._heard = arrival
        if periods > 1:
            self.inlet.account.expect(periods - 1)
            self.inlet.account.miss(periods - 1, "gap")

    async def _next(self, client: aiomqtt.Client) -> aiomqtt.Message:
        """The next message. Raises ``ConnectError`` when there is none for long, or the broker is gone."""
        s = self.settings
        try:
            async with asyncio.timeout(s.silence):
                message = await anext(aiter(client.messages))
            _obey_cancellation()
            return message
        except TimeoutError as error:
            raise ConnectError(
                f"{self._place}: nothing on {s.topic} for {s.silence:g} s; is the meter on, and is this its topic?"
            ) from error
        except aiomqtt.MqttError as error:
            raise ConnectError(f"{self._place}: the broker is gone ({error})") from error

    @asynccontextmanager
    async def _subscribed(self) -> AsyncIterator[aiomqtt.Client]:
        s = self.settings
        client = aiomqtt.Client(
            s.host,
            s.port,
            username=s.user,
            password=None if s.password is None else s.password.get_secret_value(),
            timeout=s.timeout,
            max_queued_incoming_messages=MOST_WAITING,
        )
        try:
            await _enter(client)
        except aiomqtt.MqttError as error:
            raise ConnectError(f"{self._place}: no broker takes us ({error}); check address and password") from error
        try:
            try:
                await client.subscribe(s.topic)
                _obey_cancellation()
            except aiomqtt.MqttError as error:
                raise ConnectError(f"{self._place}: {s.topic} cannot be subscribed ({error})") from error
            yield client
        finally:
            await _leave(client)

    @property
    def _place(self) -> str:
        return f"{self.settings.host}:{self.settings.port}"

    def _identity(self) -> Identity:
        return Identity("", "MQTT meter", serial=self.settings.topic)


async def _enter(client: aiomqtt.Client) -> None:
    """Connect. The library connects in a thread: one that is cancelled meanwhile is closed once it is open."""
    opening = asyncio.ensure_future(client.__aenter__())
    try:
        await asyncio.shield(opening)
    except asyncio.CancelledError:
        await asyncio.wait([opening])
        if opening.exception() is None:
            await _leave(client)
        raise


def _obey_cancellation() -> None:
    """The library uses ``asyncio.wait_for``: up to Python 3.11 that forgets a cancellation that meets the answer."""
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


async def _leave(client: aiomqtt.Client) -> None:
    with suppress(aiomqtt.MqttError):  # it was gone already, and that has been told
        await client.__aexit__(None, None, None)


def _bytes(message: aiomqtt.Message) -> bytes:
    return message.payload if isinstance(message.payload, bytes) else str(message.payload).encode()
