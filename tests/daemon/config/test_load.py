from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest

from cellwatt.config import FrameSettings, load, public_config
from cellwatt.errors import ConfigError
from cellwatt.runtime.change import Change
from tests.daemon.config.conftest import VALID
from tests.daemon.config.fakes import ArmSettings, BusSettings, CutSettings, WatchSettings

SMALL = "site: a\ncell: b\nsources:\n  arm: {driver: arm, host: h}\n"


def test_valid_file(cell_file):
    config = load(cell_file)
    assert (config.path, config.text) == (cell_file, VALID)
    assert (config.site, config.cell, config.robot) == ("plant-1", "weld-3", "testarm")
    assert list(config.sources) == ["arm", "board"]
    arm = config.sources["arm"]
    assert (arm.name, arm.driver, arm.settings) == ("arm", "arm", ArmSettings(host="192.0.2.10"))
    assert config.frames == FrameSettings(rate=50.0, latency=0.1)
    assert [(s.name, s.kind) for s in config.stages.values()] == [("cut", "cut"), ("power", "net"), ("watch", "watch")]
    assert config.stages["cut"].settings == CutSettings()
    assert config.stages["watch"].settings == WatchSettings(tolerance=0.1)
    assert config.stages["power"].place == f"{cell_file}:12:3"
    assert config.record is not None
    assert config.record.keep == 20e9
    assert list(config.outlets) == ["zenoh"]
    assert config.outlets["zenoh"].settings == BusSettings(connect=["tcp/127.0.0.1:7447"])


@pytest.mark.parametrize("line", ["zenoh: off", "zenoh: No", "zenoh: false", "zenoh: 'off'"])
def test_zenoh_can_be_switched_off(load_text, line):
    assert load_text(f"{SMALL}{line}\n").outlets == {}


def test_relative_paths_start_at_the_file(cell_file):
    config = load(cell_file)
    assert config.record is not None
    assert config.record.folder == cell_file.parent / "recordings"
    assert config.stages["power"].settings.file == cell_file.parent / "model.txt"
    assert config.folder == cell_file.parent


def test_a_tilde_is_the_home_folder(load_text, monkeypatch):
    monkeypatch.setenv("HOME", "/home/anna")
    assert load_text(f"{SMALL}record: {{folder: ~/recordings}}\n").record.folder == Path("/home/anna/recordings")


def test_a_file_that_a_stage_names_and_that_was_written_again_is_a_change(cell_file):
    """A reference or model learned again under its name: a reload applies it."""

    def written(file, second):
        os.utime(file, (second, second))
        return load(cell_file)

    model = cell_file.parent / "model.txt"
    first = written(model, 1)
    assert not Change.between(first, load(cell_file))
    change = Change.between(first, written(model, 2))
    assert (change.stages, change.sources, change.outlets, change.frames) == (["power"], [], [], True)


def test_anchors_and_merge_keys(load_text):
    config = load_text(
        "site: a\ncell: b\nsources:\n"
        "  one: &arm {driver: arm, host: one, rate: 125 Hz, payload: 2.5}\n"
        "  two: {<<: *arm, host: two}\n"
        "  three: {<<: [{host: three}, *arm], payload: 1}\n"
    )
    found = {n: (s.settings.host, s.settings.rate, s.settings.payload) for n, s in config.sources.items()}
    assert found == {"one": ("one", 125.0, 2.5), "two": ("two", 125.0, 2.5), "three": ("three", 125.0, 1.0)}


def test_scalars_mean_what_they_look_like(load_text):
    """YAML 1.1 would read these as true, false, 750, 83 and a date."""
    for text in ("on", "no", "12:30", "0123", "2026-01-02", "1_000", "y"):
        assert load_text(SMALL + f"robot: {text}\n").robot == text
    assert load_text(SMALL.replace("host: h", "host: h, port: 0x7530")).sources["arm"].settings.port == 0x7530
    assert load_text(SMALL.replace("host: h", "host: h, verify: off")).sources["arm"].settings.verify is False
    assert load_text(SMALL.replace("host: h", "host: h, gains: {1: 2e-1}")).sources["arm"].settings.gains == {1: 0.2}


def test_byte_order_mark_and_windows_line_ends(load_text):
    assert load_text(b"\xef\xbb\xbf" + SMALL.replace("\n", "\r\n").encode()).cell == "b"


def test_environment(load_text):
    text = SMALL.replace("host: h", "host: '${HOST}', port: '${PORT:-30003}', note: 'a ${A}-${B:-x} $${C} $5'")
    settings = load_text(text, HOST="10.0.0.1", A="1", B="").sources["arm"].settings
    assert (settings.host, settings.port, settings.note) == ("10.0.0.1", 30003, "a 1-x ${C} $5")
    assert load_text(SMALL.replace("host: h", "host: $HOST"), PORT="1").sources["arm"].settings.host == "$HOST"


def test_public_config_hides_what_came_from_the_environment(load_text):
    text = SMALL.replace("host: h", "host: '${HOST}', user: me, password: '${PASS}', port: '${PORT}'")
    text += "record: {folder: '/rec/${PASS}'}\nzenoh: {connect: ['tls/${PASS}@router:1', tcp/b:2]}\n"
    config = load_text(text, HOST="10.0.0.1", PASS="hunter2hunter2", PORT="4711")
    assert config.sources["arm"].settings.port == 4711
    public = public_config(config)
    assert public["sources"]["arm"]["host"] == "${HOST}"
    assert public["sources"]["arm"]["password"] == "${PASS}"
    assert public["sources"]["arm"]["port"] == "${PORT}"
    assert public["sources"]["arm"]["user"] == "me"
    assert public["zenoh"]["connect"] == ["tls/${PASS}@router:1", "tcp/b:2"]
    assert public["record"]["folder"] == "/rec/${PASS}"
    text = json.dumps(public)
    assert "hunter2" not in text
    assert "4711" not in text


def test_public_config_is_in_force_and_in_base_units(cell_file):
    public = json.loads(json.dumps(public_config(load(cell_file))))
    assert public["sources"]["arm"]["rate"] == 500.0
    assert public["sources"]["arm"]["limits"]["angle"] == 0.1
    assert public["sources"]["board"] == {
        "driver": "meter",
        "port": "/dev/ttyUSB0",
        "baud": 115200,
        "unit": "W",
        "twice": False,
    }
    assert public["frames"] == {"rate": 50.0, "latency": 0.1}
    assert math.isclose(public["stages"]["watch"]["tolerance"], 0.1)
    assert public["record"]["keep"] == 20e9


def test_moving_a_stage_in_the_file_is_no_change(load_text):
    before = load_text(f"{SMALL}stages: {{cut: {{}}}}\n")
    after = load_text(f"# a comment\n{SMALL}stages: {{cut: {{}}}}\n")
    assert before.stages == after.stages
    assert before.sources == after.sources
    assert before.stages["cut"].place != after.stages["cut"].place


def test_every_mistake_is_found_in_one_pass_and_told_in_file_order(load_text):
    with pytest.raises(ConfigError) as caught:
        load_text("site: 5\nsources:\n  arm: {driver: arm, prot: 1}\n  x: {driver: ar}\nframes: {rate: 5}\nfoo: 1\n")
    lines = [p.place.split(":")[-2] for p in caught.value.problems]
    assert lines == ["1", "1", "3", "3", "4", "5", "6"]
    assert str(caught.value).count("\n") == 6
