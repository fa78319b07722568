"""Mistakes in the settings of the parts that this distribution brings: one line each, at its place.

What each driver refuses is tested with the driver.
"""

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
    "channels as a text": ("  arm: {driver: ur, host: h, channels: actual_q}", "4:40", "expected a list"),
    "pulses missing": ("  r: {driver: yaskawa, host: h}", "4:3", "pulses_per_degree"),
    "unknown answer": ("  r: {driver: yaskawa, host: h, read: [torqe]}", "4:40", "did you mean 'torque'?"),
    "too many axes": ("  r: {driver: yaskawa, host: h, read: [torque], axes: 9}", "4:55", "at most 8"),
    "not a serial port": ("  b: {driver: power_board, port: COM3}", "4:34", "path of a serial port"),
    "analyzer without an address": ("  a: {driver: scpi_analyzer}", "4:3", "sources.a"),
    "EGM out of its cycle": ("  a: {driver: abb, host: h, rate: 100 Hz}", "4:35", "250 Hz or a whole part"),
    "group that EGM lacks": ("  a: {driver: abb, host: h, egm: [joint]}", "4:35", "'joints', 'planned'"),
    "unknown RobotWare": ("  a: {driver: abb, host: h, robotware: 5}", "4:40", "6 or 7"),
    "controller without an address": ("  a: {driver: abb, egm_port: 6510}", "4:3", "host"),
    "rate without its unit": ("  f: {driver: franka, host: h, rate: 1000}", "4:38", "a number with its unit"),
    "unknown group": ("  f: {driver: franka, host: h, read: [torques]}", "4:39", "expected 'joints', 'targets'"),
    "five joints": ("  k: {driver: kinova, host: h, axes: 5}", "4:38", "at least 6"),
    "unknown meter": (
        "  m: {driver: modbus_meter, host: h, meter: eastron_sdm63}",
        "4:45",
        "did you mean 'eastron_sdm630'?",
    ),
    "map that is not there": (
        "  m: {driver: modbus_meter, host: h, map: none.yaml}",
        "4:43",
        "expected a file that exists",
    ),
    "map of a sensor that is not there": (
        "  c: {driver: can_sensor, map: none.yaml}",
        "4:32",
        "expected a file that exists",
    ),
    "unknown sensor": ("  c: {driver: can_sensor, sensor: ivt}", "4:35", "did you mean 'ivt_s'?"),
    "bit rate of SocketCAN": (
        "  c: {driver: can_sensor, sensor: ivt_s, bitrate: 500000}",
        "4:3",
        "set with ip link",
    ),
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
