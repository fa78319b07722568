"""Mistakes in the settings of outlets are refused in words."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from cellwatt.door.settings import Listening
from cellwatt.outlet import OutletSettings
from cellwatt.outlets.historian import HistorianSettings, InfluxSettings
from cellwatt.outlets.metrics.settings import MetricsSettings
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.opc_ua.outlet import OpcUaOutletSettings
from cellwatt.outlets.page import PageSettings
from cellwatt.outlets.zenoh.link import LinkSettings
from tests.daemon.outlets.page.cell import HASH, PASSWORD, USERS

MISTAKES: dict[type[OutletSettings], list[tuple[dict[str, Any], str]]] = {
    HistorianSettings: [
        ({}, "expected influx, lake, or both"),
        ({"influx": {"url": "influx:8086", "database": "d"}}, "expected an address like"),
        ({"influx": {"url": "http://u:p@127.0.0.1", "database": "d"}}, "not into the address"),
        ({"influx": {"url": "http://127.0.0.1"}}, "one of database"),
        ({"influx": {"url": "http://influx.example", "database": "d"}}, "http is for this PC alone"),
        ({"lake": {"folder": "l", "dead_band": {"*": 1.0}}}, "every row"),
        ({"lake": {"folder": "s3://B C"}}, "expected s3://BUCKET/PATH"),
        ({"lake": {"folder": "s3://bucket", "endpoint": "http://minio.example"}}, "http is for this PC alone"),
    ],
    MqttSettings: [
        ({"broker": "broker"}, "expected mqtt://host:port"),
        ({"broker": "mqtts://a:b@host"}, "expected mqtt://host:port"),
        ({"broker": "mqtt://192.0.2.1"}, "no TLS: anyone on the network path can read"),
        ({"password": "x"}, "a password needs a user"),
        ({"broker": "mqtts://h", "certificate": "c.pem"}, "certificate and key are needed together"),
        ({"keep_alive": "0.5 s"}, "expected 1 s to 65535 s"),
        ({"sparkplug": {"group": "a/b"}}, "is not a Sparkplug ID"),
    ],
    OpcUaOutletSettings: [
        ({"trusted": [__file__]}, "of use only with a certificate"),
    ],
    PageSettings: [
        ({"listen": "8480"}, "'8480' is not an address; expected host:port, like 127.0.0.1:8480"),
        ({"names": ["a b"]}, "expected a host name"),
        ({"certificate": "a.pem"}, "certificate and key are needed together"),
        ({"users": {"ada": {"password": PASSWORD}}}, "expected the hash of a password, as 'cellwatt view"),
        ({"users": {"ada": {"password": HASH, "may": "do"}}}, "'look' or 'act'"),
        ({"users": {"a\nb": {"password": HASH}}}, "printable characters"),
        ({"users": {"": {"password": HASH}}}, "1 to 100"),
    ],
}


@pytest.mark.parametrize(
    ("model", "settings", "words"), [(model, *case) for model, cases in MISTAKES.items() for case in cases]
)
def test_mistakes_are_refused_in_words(model: type[OutletSettings], settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(words)):
        model.model_validate(settings)


TLS = {"certificate": "door.pem", "key": "door.key"}
SEEN, SENT = "anyone who reaches it sees the cell", "passwords and data are sent unencrypted"
STRANGERS: list[tuple[type[Listening], dict[str, Any], str]] = [
    (MetricsSettings, {"listen": "0.0.0.0:9480"}, f"TLS and a token: {SEEN}"),
    (MetricsSettings, {"listen": "0.0.0.0:9480", "token": "t"}, f"TLS: {SENT}"),
    (OpcUaOutletSettings, {"listen": "0.0.0.0:4840"}, f"a certificate and users or trusted certificates: {SEEN}"),
    (OpcUaOutletSettings, {"listen": "0.0.0.0:4840", "users": {"eve": "x"}}, f"a certificate: {SENT}"),
    (PageSettings, {"listen": "0.0.0.0:8480"}, f"TLS and users: {SEEN}"),
    (PageSettings, {"listen": "weld-3:8480", "users": USERS}, f"TLS: {SENT}"),
    (PageSettings, {"listen": "192.0.2.1:8480", **TLS}, f"users: {SEEN}"),
]


@pytest.mark.parametrize(("model", "settings", "lacks"), STRANGERS)
def test_strangers_are_let_in_only_on_purpose(model: type[Listening], settings: dict[str, Any], lacks: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(f"open to the network without {lacks}")):
        model.model_validate(settings)
    first, *_ = model.model_validate({**settings, "open": True}).warnings()
    assert first == f"listen: {settings['listen']}: open to the network without {lacks} (open: true)"


@pytest.mark.parametrize(
    "model",
    [InfluxSettings, LinkSettings, MetricsSettings, OpcUaOutletSettings, PageSettings],
    ids=lambda model: model.__name__,
)
def test_a_renewed_file_is_a_change_that_a_reload_applies(model: type[OutletSettings], tmp_path: Path) -> None:
    """Nothing in the settings file itself has changed; another file cannot be read."""
    file = tmp_path / "file.pem"
    file.touch()
    settings: dict[str, Any] = {"certificate": file, "key": tmp_path / "missing"}
    if model is LinkSettings:
        tls = {"certificate": file, "root_ca": tmp_path, "key": tmp_path / "missing"}
        settings = {"mode": "client", "connect": ["tls/plant-router:7447"], "tls": tls}
    if model is InfluxSettings:
        settings = {"url": "https://influx.example", "database": "d", "ca": file}
    before = model.model_validate(settings)
    assert model.model_validate(settings) == before
    os.utime(file, (1.0, 1.0))
    assert model.model_validate(settings) != before
