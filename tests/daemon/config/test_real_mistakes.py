"""Mistakes in the settings of the parts that this distribution brings: one line each, at its place."""

from __future__ import annotations

from importlib.metadata import entry_points

import pytest

from cellwatt import registry
from cellwatt.config import load
from cellwatt.errors import ConfigError
from cellwatt.runtime.assemble import prepare

UR = "  arm: {driver: ur, host: h}\n"
MISTAKES = {
    "rate out of reach": ("  arm: {driver: ur, host: h, rate: 600 Hz}", "4:36", "arm.rate"),
    "unknown RTDE field": ("  arm: {driver: ur, host: h, channels: [actual_Q]}", "4:40", "did you mean 'actual_q'?"),
    "no channel": ("  arm: {driver: ur, host: h, channels: []}", "4:40", "arm.channels"),
    "channels as a text": ("  arm: {driver: ur, host: h, channels: actual_q}", "4:40", "expected a list"),
    "unknown client": ("  arm: {driver: ur, host: h, client: rtde}", "4:38", "'native' or 'ur_rtde'"),
    "pulses missing": ("  r: {driver: yaskawa, host: h}", "4:3", "pulses_per_degree"),
    "pulses for three axes": ("  r: {driver: yaskawa, host: h, pulses_per_degree: [1, 2, 3]}", "4:3", "6 axes"),
    "unknown answer": ("  r: {driver: yaskawa, host: h, read: [torqe]}", "4:40", "did you mean 'torque'?"),
    "too many axes": ("  r: {driver: yaskawa, host: h, read: [torque], axes: 9}", "4:55", "at most 8"),
    "not a serial port": ("  b: {driver: power_board, port: COM3}", "4:34", "path of a serial port"),
    "baud as a text": ("  b: {driver: power_board, port: /dev/ttyS9, baud: fast}", "4:52", "a whole number"),
    "unknown mode": ("  b: {driver: power_board, port: /dev/ttyS9, mode: api2}", "4:52", "did you mean 'api'?"),
    "analyzer without an address": ("  a: {driver: scpi_analyzer}", "4:3", "sources.a"),
    "segments without an arm": (
        "  b: {driver: power_board, port: /dev/ttyS9}\nstages: {segment: {}}",
        "5:10",
        "no source gives joint_1.position",
    ),
    "segments of another arm": (f"{UR}stages: {{segment: {{arm: arn}}}}", "5:10", "'arn'"),
    "speed in degrees": (f"{UR}stages: {{segment: {{start_speed: 1 deg}}}}", "5:33", "deg/s"),
    "faults without segments": (f"{UR}stages: {{faults: {{}}}}", "5:10", "needs a stage of the kind 'segment'"),
    "model without a file": (f"{UR}stages: {{model: {{}}}}", "5:10", "file"),
    "no endpoint": (f"{UR}zenoh: {{connect: [plant-router:7447]}}", "5:18", "tcp/192.0.2.1:7447"),
    "TLS without certificates": (f"{UR}zenoh: {{connect: [tls/router:7447]}}", "5:1", "needs tls"),
    "user without a password": (f"{UR}zenoh: {{user: x}}", "5:1", "password"),
    "option that Zenoh does not know": (f"{UR}zenoh: {{options: {{transport/nonsense: 4}}}}", "5:1", "unknown key"),
}


@pytest.fixture(autouse=True)
def _real_parts(monkeypatch: pytest.MonkeyPatch, _fake_parts: None) -> None:
    monkeypatch.setattr(registry, "entry_points", entry_points)
    registry.available.cache_clear()


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake(tmp_path, name):
    text, place, message = MISTAKES[name]
    file = tmp_path / "cell.yaml"
    file.write_text(f"site: a\ncell: b\nsources:\n{text}\n")
    with pytest.raises(ConfigError) as caught:
        prepare(load(file, {}))
    lines = [str(p) for p in caught.value.problems if message in str(p)]
    assert len(lines) == 1, caught.value
    assert lines[0].startswith(f"{file}:{place}: ")
    assert "\n" not in lines[0]
