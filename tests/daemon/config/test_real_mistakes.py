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
    "not a serial port": ("  b: {driver: power_board, port: COM3}", "4:34", "path of a serial port"),
    "EGM out of its cycle": ("  a: {driver: abb, host: h, rate: 100 Hz}", "4:35", "250 Hz or a whole part"),
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
    "faults without segments": (f"{UR}stages: {{faults: {{}}}}", "5:10", "needs a stage of the kind 'segment'"),
    "no endpoint": (f"{UR}zenoh: {{connect: [plant-router:7447]}}", "5:18", "tcp/192.0.2.1:7447"),
    "TLS without certificates": (f"{UR}zenoh: {{connect: [tls/router:7447]}}", "5:1", "needs tls"),
    "option that Zenoh does not know": (f"{UR}zenoh: {{options: {{transport/nonsense: 4}}}}", "5:1", "unknown key"),
}


@pytest.fixture(autouse=True)
def _real_parts(monkeypatch: pytest.MonkeyPatch, _fake_parts: None) -> None:
    monkeypatch.setattr(registry, "entry_points", entry_points)
    registry.available.cache_clear()


def test_each_mistake_is_one_line_at_its_place(tmp_path):
    for name, (text, place, message) in MISTAKES.items():
        file = tmp_path / "cell.yaml"
        file.write_text(f"site: a\ncell: b\nsources:\n{text}\n")
        with pytest.raises(ConfigError) as caught:
            prepare(load(file, {}))
        lines = [str(p) for p in caught.value.problems if message in str(p)]
        assert len(lines) == 1, (name, caught.value)
        assert lines[0].startswith(f"{file}:{place}: ") and "\n" not in lines[0], (name, lines)
