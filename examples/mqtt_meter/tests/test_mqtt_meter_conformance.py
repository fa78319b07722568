"""The driver keeps cellwatt's contract."""

from __future__ import annotations

from mqtt_meter import MqttMeterDriver
from mqtt_meter.broker import CONNECT, DISCONNECT, PINGREQ, SUBSCRIBE

from cellwatt.testing import DriverConformance, Rig

RATE = "25"


def only_subscribes(sent: bytes) -> bool:
    """Whether a connection holds nothing but packets that publish nothing (all shorter than 128 bytes)."""
    while sent:
        kind, length = sent[0] >> 4, sent[1]
        if kind not in {CONNECT, SUBSCRIBE, PINGREQ, DISCONNECT} or length >= 0x80 or len(sent) < 2 + length:
            return False
        sent = sent[2 + length :]
    return True


class TestConformance(DriverConformance):
    rigs = (
        Rig(
            MqttMeterDriver,
            {"rate": f"{RATE} Hz", "silence": "500 ms", "timeout": "1 s"},
            may_send=only_subscribes,
            options={"rate": RATE},
        ),
    )
