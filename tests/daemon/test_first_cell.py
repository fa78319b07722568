"""A first settings file is right by construction, and so is each of its commented lines."""

from __future__ import annotations

import re

import pytest
import yaml

from cellwatt.config import load
from cellwatt.config.document import read
from cellwatt.config.installed import installed
from cellwatt.config.loading import load_document
from cellwatt.config.reference import in_yaml
from cellwatt.errors import ConfigError
from cellwatt.first_cell import SourcePlan, parse_source, write_cell
from cellwatt.runtime.assemble import prepare

GIVEN = {
    "abb": {},
    "can_sensor": {"sensor": "ivt_s"},
    "opc_ua": {"model": "opc_40010"},
    "modbus_meter": {"meter": "eastron_sdm630"},
    "power_board": {},
    "yaskawa": {"pulses_per_degree": "[1341.4, 1341.4, 1341.4, 1000, 1000, 622]"},
}
"""What a user must add to the address."""
ADDRESSES = {"power_board": "/dev/ttyUSB0", "can_sensor": "can0"}
_OFF = re.compile(r"^( *)# ([a-z_]+: .*)$")


def source(driver: str) -> SourcePlan:
    found = parse_source(f"device={driver}:{ADDRESSES.get(driver, '192.0.2.10')}")
    return SourcePlan("device", driver, {**found.settings, **GIVEN.get(driver, {})})


@pytest.mark.parametrize("driver", [part.name for part in installed("driver") if part.package == "cellwatt"])
def test_it_passes_for_every_driver_and_every_default_of_a_source_may_be_switched_on(driver, tmp_path):
    if driver == "franka":
        pytest.importorskip("pylibfranka", reason="the driver needs pylibfranka")
    written = tmp_path / "cell.yaml"
    write_cell(written, "plant", "weld", [source(driver)])
    assert list(tmp_path.iterdir()) == [written]
    text = written.read_text()
    on, in_sources = [], False
    for line in text.splitlines():
        in_sources = line == "sources:" or (in_sources and line != "" and not line.startswith("# frames"))
        off = _OFF.match(line) if in_sources else None
        value = yaml.safe_load(off[2]) if off and not off[2].endswith(":") else None
        shown = isinstance(value, dict) and next(iter(value.values())) is not None
        on.append(f"{off[1]}{off[2]}" if off and shown else line)
    assert on != text.splitlines()
    before = load(written)
    written.write_text("\n".join(on))
    assert load(written).sources["device"].settings == before.sources["device"].settings


@pytest.mark.parametrize("name", ["frames", "mqtt", "metrics", "opc_ua", "page", "units"])
def test_a_section_without_required_keys_may_be_switched_on_as_it_stands(name, tmp_path):
    file = tmp_path / "cell.yaml"
    write_cell(file, "plant", "weld", [source("ur")])
    text = file.read_text()
    section = re.search(rf"^# {name}:.*\n(?:#.*\n)+", text, re.MULTILINE)
    assert section is not None
    file.write_text(text.replace(section[0], re.sub(r"^# ", "", section[0], flags=re.MULTILINE)))
    prepare(load_document(read(file, {})))


def test_what_a_driver_needs_besides_its_address_is_asked_for(tmp_path):
    with pytest.raises(ConfigError, match=r"pulses_per_degree needs .*; give it as --set NAME\.KEY=VALUE"):
        write_cell(tmp_path / "cell.yaml", "plant", "weld", [parse_source("arm=yaskawa:192.0.2.10")])


def test_an_arm_has_segments_and_a_meter_has_none(tmp_path):
    file = tmp_path / "cell.yaml"
    write_cell(file, "plant", "weld", [source("ur")])
    assert list(load(file).stages) == ["segment"]
    write_cell(file, "plant", "weld", [source("scpi_analyzer")])
    assert not load(file).stages


@pytest.mark.parametrize(
    ("text", "settings"),
    [
        ("a=ur:192.0.2.10", {"host": "192.0.2.10"}),
        ("a=ur:192.0.2.10:30004", {"host": "192.0.2.10", "port": "30004"}),
        ("a=ur:2001:db8::1", {"host": '"2001:db8::1"'}),
        ("a=ur:[2001:db8::1]", {"host": '"2001:db8::1"'}),
        ("a=ur", {}),
        ("a=scpi_analyzer:/dev/ttyACM0", {"serial": "/dev/ttyACM0"}),
        ("a=can_sensor:can0", {"channel": "can0"}),
    ],
)
def test_an_address_becomes_settings(text, settings):
    assert parse_source(text).settings == settings


def test_mistakes_in_a_source_are_named():
    for text in ("ur:192.0.2.10", "arm=", "arm"):
        with pytest.raises(ConfigError, match="expected NAME=DRIVER:ADDRESS"):
            parse_source(text)
    with pytest.raises(ConfigError, match="did you mean 'ur'"):
        parse_source("arm=urr:192.0.2.10")
    with pytest.raises(ConfigError, match="expected small letters"):
        parse_source("Arm=ur:192.0.2.10")


def test_a_text_stays_one_in_yaml():
    for text in ("true", "1e3", "12", "a: b", "x # y", "", "~", "weld_3", "192.0.2.10", "ä", "- a"):
        assert yaml.safe_load(f"site: {in_yaml(text)}") == {"site": text}
