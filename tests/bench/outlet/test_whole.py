"""The outlet over OPC UA, and whole daemons with outlets, for a second each."""

from __future__ import annotations

import asyncio

import pytest
from outlet import blocked, opc_ua
from outlet.children import child
from outlet.rows import CHANNELS
from outlet.servers import MOSQUITTO

pytestmark = [pytest.mark.slow, pytest.mark.system]


def test_a_client_gets_each_value_of_a_plain_opc_ua_server() -> None:
    with child("opc_ua_plain") as plain_server, child("opc_ua_reader", plain_server.answer()) as reader:
        assert reader.answer() == "ready"
        reader.ask({})
        plain_server.ask([0, 7])
        assert reader.ask({"expected": 7 * CHANNELS})["count"] == 7 * CHANNELS
        reader.ask({})
        plain_server.ask([100, 3])
        assert reader.ask({"expected": 3 * CHANNELS})["count"] == 3 * CHANNELS


def test_the_opc_ua_outlet_brings_every_value_at_its_rate() -> None:
    found = asyncio.run(opc_ua.ours(1.0))
    assert list(found) == list(opc_ua.PACES)
    assert found["at_50_hz"]["lost"] == found["as_fast"]["lost"] == 0
    assert all(figures["core_percent"] > 0 for figures in found.values())


@pytest.mark.parametrize("way", blocked.WAYS)
def test_a_daemon_and_its_outlets(way: str) -> None:
    if way == "answering" and MOSQUITTO is None:
        pytest.skip("mosquitto is not installed")
    found = asyncio.run(blocked.run(way, 1.0))
    assert {"collect_percent", "align_percent", "judge segment_percent", "tell_percent"} < set(found)
    assert found["pss_mb"] > found["tell_pss_mb"] > 0
    assert 0 < found["p50_ms"] <= found["p99_ms"]
    delivered = [found[f"{name}_delivered"] for name in blocked.DELIVERED]
    assert all(delivered) if way == "answering" else not any(delivered)
