"""What a broker hands to the outlet to MQTT: Sparkplug's commands and the primary host's state, kept alarms."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from typing import Final

from cellwatt.alarms import AlarmBook
from cellwatt.errors import ProtocolError
from cellwatt.outlets.mqtt.edge_node import EdgeNode
from cellwatt.outlets.mqtt.message import Order
from cellwatt.outlets.mqtt.payload import DataType, decode, encode, metric
from cellwatt.outlets.mqtt.plain import PlainFormat
from cellwatt.outlets.mqtt.settings import MqttSettings, SparkplugSettings
from fuzz.items import SESSION
from fuzz.target import Target

COMMAND: Final = "spBv1.0/plant/NCMD/weld"
STATE: Final = "spBv1.0/STATE/scada"
KEPT: Final = "cellwatt/plant/weld/alarm/error/joint_fault/a1"
TOPICS: Final = (COMMAND, STATE, KEPT, "cellwatt/plant/weld/health")


@cache
def _plain() -> PlainFormat:
    return PlainFormat(MqttSettings(), "plant", "weld", AlarmBook())


def run(data: bytes) -> None:
    """Messages in turn: a byte for the topic and whether it is retained, one for the length, the payload."""
    node = EdgeNode(SparkplugSettings(primary_host="scada"), "plant", "weld", AlarmBook())
    node.connect()
    node.birth(SESSION // 10**6)
    at = 0
    while at + 2 <= len(data):
        topic, retained = TOPICS[data[at] % len(TOPICS)], bool(data[at] & 0x80)
        payload = data[at + 2 : at + 2 + data[at + 1]]
        at += 2 + data[at + 1]
        for heard in (node.heard, _plain().heard):
            with suppress(ProtocolError):
                found = heard(topic, payload, retained)
                assert isinstance(found, Order) or all(m.topic == topic and not m.payload for m in found)
        with suppress(ProtocolError):
            for name, value in decode(payload):
                assert name is None or isinstance(name, str)
                assert value is None or isinstance(value, float | int | bool | str)


def _message(topic: str, payload: bytes, retained: bool = False) -> bytes:
    return bytes([TOPICS.index(topic) | retained << 7, len(payload)]) + payload


def seeds() -> Iterable[bytes]:
    """Commands, the host that comes and goes, an alarm that the broker keeps."""
    again = metric(DataType.BOOLEAN, True, 5, name="Node Control/Rebirth", declared=True)
    other = metric(DataType.STRING, "x", 5, alias=7, unit="W", declared=True)
    online = _message(STATE, b'{"online": true, "timestamp": 5}')
    yield online + _message(COMMAND, encode([again, other], 5, 1))
    yield online + _message(STATE, b'{"online": false, "timestamp": 6}') + _message(STATE, b"OFFLINE")
    yield _message(KEPT, b"{}", retained=True)
    yield _message(COMMAND, encode([again], 5, None).replace(b"Node", b"\xff\xfeod"))


TARGET = Target(run, seeds, 1024)
