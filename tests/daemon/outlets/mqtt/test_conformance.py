"""MQTT as any outlet: brokers that are away, silent or lying, and restarts."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from cellwatt.outlets.mqtt.outlet import MqttOutlet
from cellwatt.testing import OutletConformance, OutletRig
from cellwatt.testing.outlet_suite import CHECKS, counts_what_is_refused
from tests.daemon.outlets.mqtt.broker import Broker, Ears, ears, needs_mosquitto, started
from tests.daemon.outlets.mqtt.cell import ROOT

pytestmark = needs_mosquitto
ANSWERED = [check for check in CHECKS if check is not counts_what_is_refused]
"""What a broker refuses is no row but a message: see ``test_cut``."""


class Heard:
    refuse = False

    def __init__(self, broker: Broker, heard: Ears) -> None:
        self.address, self._heard = broker.url.removeprefix("mqtt://"), heard

    @property
    def got(self) -> list[int]:
        rows = (f"{ROOT}/frame", f"{ROOT}/backfill/frame")
        return [json.loads(message.payload)["time"] for message in self._heard.heard if message.topic in rows]


@asynccontextmanager
async def peer() -> AsyncIterator[Heard]:
    with TemporaryDirectory() as folder:
        async with started(Path(folder)) as broker, ears(broker, f"{ROOT}/#") as heard:
            yield Heard(broker, heard)


def at(address: str) -> dict[str, object]:
    return {"broker": f"mqtt://{address}"}


RIG = OutletRig(MqttOutlet, {"rate": "10 Hz", "backfill": "1 kHz"}, peer, at)


@pytest.mark.parametrize("check", ANSWERED, ids=lambda check: check.__name__)
def test_mqtt_conforms(check: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.outlets.mqtt.link.ANSWER", 0.5)
    OutletConformance().test_outlet(RIG, check, tmp_path)
