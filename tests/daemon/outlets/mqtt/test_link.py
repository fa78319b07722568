"""One connection to a broker."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from aiomqtt import MqttError

from cellwatt.outlets.mqtt.link import Link, reason
from cellwatt.outlets.mqtt.message import Message, Subscription
from cellwatt.outlets.mqtt.settings import MqttSettings
from tests.daemon.outlets.mqtt.broker import Broker, needs_mosquitto

pytestmark = needs_mosquitto


async def test_a_cancellation_that_comes_together_with_the_answer_is_heard(broker: Broker) -> None:
    settings = MqttSettings.model_validate({"broker": broker.url})
    link = Link(settings, "me", Message("will", b""), None, lambda reason: None)
    await link.open()
    library = link._client._client
    answered = library.on_subscribe
    assert answered is not None

    def answer(*told: Any) -> None:
        answered(*told)
        subscribing.cancel()

    library.on_subscribe = answer
    try:
        subscribing = asyncio.create_task(link.subscribe(Subscription("a/#", 1)))
        with pytest.raises(asyncio.CancelledError):
            await subscribing
    finally:
        await link.close(with_will=False)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("Operation timed out", "no answer within 10 s: the broker hangs or is too busy, or it is none"),
        ("timed out", "nobody answers: is the host up?"),
        ("_ssl.c:985: The handshake operation timed out", "no answer to the TLS handshake: is this a port for TLS?"),
    ],
)
def test_a_broker_that_is_slow_is_told_as_that(text: str, told: str) -> None:
    assert reason(MqttError(text)) == told
