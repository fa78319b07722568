"""Secrets within addresses are told nowhere; what is no secret stays readable."""

from __future__ import annotations

import time

import pytest

from cellwatt.host import blank, secrets_of

BLANKED = {
    "mqtt://u:hunter2@plant:1883": "mqtt://***@plant:1883",
    "found 'https://u:p@ss@h/x', expected": "found 'https://***@h/x', expected",
    "ftp://token@host/a": "ftp://***@host/a",
    "found 'u:hunter2@192.0.2.1'": "found 'u:***@192.0.2.1'",
    "https://h/a?X-Amz-Signature=abc&part=2": "https://h/a?X-Amz-Signature=***&part=2",
    "https://h/a?part=2&sig=a%2Bb#x": "https://h/a?part=2&sig=***#x",
    "tls/h:7447#connect_private_key_base64=abc": "tls/h:7447#connect_private_key_base64=***",
    "one ws://a:b@c two ws://d:e@f": "one ws://***@c two ws://***@f",
}
PLAIN = (
    "expected mqtt://host:port or mqtts://host:port, like mqtt://127.0.0.1:1883",
    "tcp/192.0.2.1:7447",
    "opc.tcp://[::1]:4840/cellwatt",
    "mail to: ada@plant.example",
    "http://h/a?start=1&end=2",
    "12:30 said ada@plant",
)


@pytest.mark.parametrize("text", BLANKED)
def test_secrets_of_addresses_are_blanked(text: str) -> None:
    assert blank(text) == BLANKED[text]


@pytest.mark.parametrize("text", PLAIN)
def test_what_is_no_secret_stays(text: str) -> None:
    assert blank(text) == text
    assert not list(secrets_of(text))


def test_secrets_are_known_as_written_and_as_meant() -> None:
    assert set(secrets_of("mqtt://u:p%40ss@h?token=a%2Fb")) == {"p%40ss", "p@ss", "a%2Fb", "a/b"}


@pytest.mark.parametrize("piece", ["://", "?", "?token", "a:", "@", "://a@", "?x=", "a:b@"])
def test_a_hostile_text_takes_no_time(piece: str) -> None:
    began = time.process_time()
    blank(piece * 20_000)
    assert time.process_time() - began < 5.0
