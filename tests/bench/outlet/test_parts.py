"""Each part of bench/outlets.py for a moment: what it counts is what was sent."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from outlet import historian, influx, metrics, mqtt
from outlet.children import child
from outlet.mqtt_plain import plain
from outlet.rows import frames
from outlet.servers import INFLUXD, MOSQUITTO, influxd, mosquitto, silent

SCRIPT = Path(__file__).resolve().parents[3] / "bench" / "outlets.py"

needs_mosquitto = pytest.mark.skipif(MOSQUITTO is None, reason="mosquitto is not installed")
needs_influxd = pytest.mark.skipif(INFLUXD is None, reason="influxd is not installed")


def test_a_channel_is_never_0_nor_the_same_twice_in_a_row() -> None:
    values = frames(0, 3000).values
    assert np.all(values != 0) and np.all(np.diff(values, axis=0) != 0)


def test_a_silent_server_takes_connections_and_says_nothing() -> None:
    with silent() as port, socket.create_connection(("127.0.0.1", port.port), timeout=0.1) as client:
        client.sendall(b"GET / HTTP/1.1\r\n\r\n")
        with pytest.raises(TimeoutError):
            client.recv(1)
        assert port.taken == 1


@needs_mosquitto
@pytest.mark.parametrize("give", [mqtt.flood, plain(64)], ids=["cellwatt", "aiomqtt"])
def test_rows_over_mqtt_are_counted(tmp_path: Path, give) -> None:
    with mosquitto(tmp_path) as broker:
        found = mqtt.through(broker.port, give, 1, 0.2)
    assert found["lost"] == 0
    assert found["rows_per_s"] > 0


def test_the_endpoint_has_the_series_of_a_cell() -> None:
    found = asyncio.run(metrics.run(0.1))
    assert found["series"] > 16 and found["bytes"] > 100 * found["series"] / 2
    assert found["answers_per_s"] > 0 and found["plain_answers_per_s"] > 0


def test_a_lake_has_all_rows_of_the_record(tmp_path: Path) -> None:
    record = tmp_path / "record"
    record.mkdir()
    historian.recorded(record, 20)
    assert historian.lake(record, tmp_path)["rows"] == 20 * 50


@needs_influxd
def test_rows_into_influxdb(tmp_path: Path) -> None:
    record = tmp_path / "record"
    record.mkdir()
    historian.recorded(record, 12)
    with influxd(tmp_path / "influx") as url:
        for way in (influx.offered, influx.posted):
            assert asyncio.run(way(url, 0.1))["rows_per_s"] > 0
        assert asyncio.run(influx.filled(url, record, 12))["rows_per_s"] > 0


def test_a_process_that_ends_is_told() -> None:
    with child("opc_ua_reader", "opc.tcp://127.0.0.1:1/nobody") as reader, pytest.raises(RuntimeError, match="ended"):
        reader.answer()


def test_the_command_prints_a_table() -> None:
    command = [sys.executable, str(SCRIPT), "metrics", "--seconds", "0.1", "--repeats", "2", "--markdown"]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert told[0].startswith("| outlet | way | a second |")
    assert [line.split(" | ")[1] for line in told[2:]] == ["cellwatt", "prometheus-client"]
