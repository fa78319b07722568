"""One connection to a broker."""

from __future__ import annotations

import pytest

from cellwatt.outlets.mqtt.link import reason


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("timed out", "nobody answers: is the host up?"),
        ("_ssl.c:985: The handshake operation timed out", "no answer to the TLS handshake: is this a port for TLS?"),
    ],
)
def test_a_broker_that_is_slow_is_told_as_that(text: str, told: str) -> None:
    assert reason(TimeoutError(text)) == told
