from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cellwatt.outlets.mqtt.settings import MqttSettings


def settings(**told: Any) -> MqttSettings:
    return MqttSettings.model_validate(told)


@pytest.mark.parametrize(
    ("broker", "host", "port", "encrypted"),
    [
        ("mqtt://127.0.0.1", "127.0.0.1", 1883, False),
        ("mqtt://[::1]:2000", "::1", 2000, False),
        ("mqtts://broker.plant", "broker.plant", 8883, True),
    ],
)
def test_a_broker_has_host_and_port(broker: str, host: str, port: int, encrypted: bool) -> None:
    found = settings(broker=broker)
    assert (found.host, found.port, found.encrypted) == (host, port, encrypted)


def test_what_is_open_on_purpose_and_what_cannot_be_read_is_warned_of(tmp_path: Path) -> None:
    (opened,) = settings(broker="mqtt://192.0.2.1", open=True).warnings()
    assert opened.startswith("broker: mqtt://192.0.2.1: no TLS") and opened.endswith("(open: true)")
    (missing,) = settings(broker="mqtts://broker.plant", ca=str(tmp_path / "ca.pem")).warnings()
    assert "ca.pem cannot be read: No such file" in missing
    assert settings().warnings() == ()
