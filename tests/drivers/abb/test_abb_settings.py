from __future__ import annotations

import pytest
from pydantic import ValidationError

from cellwatt.errors import ConfigError
from cellwatt_drivers.abb import AbbDriver, AbbSettings
from cellwatt_drivers.shared import requirements

from ..inlet import CollectingInlet


def streams(**changes):
    made = AbbDriver("arm", AbbSettings.model_validate({"host": "192.0.2.1"} | changes), CollectingInlet())
    return {s.name: s for s in made.streams}


def test_by_default_motion_states_and_energy_are_read():
    found = streams()
    assert list(found) == ["egm", "controller", "energy"]
    assert (found["egm"].rate, found["egm"].clock) == (250.0, "device")
    assert found["egm"].names[:2] == ("joint_1.position", "joint_2.position")
    assert "joint_6.target_position" in found["egm"].names
    assert (found["controller"].rate, found["controller"].clock) == (2.0, "host")
    assert found["energy"].channels[0].kind == "counter"


def test_either_half_alone():
    assert list(streams(web=[])) == ["egm"]
    assert list(streams(egm=[], web=["energy"])) == ["energy"]
    assert streams(web=[], rate="62.5 Hz", external=["rotary"])["egm"].names[6] == "external_1.position"


def test_a_missing_library_is_named(monkeypatch):
    monkeypatch.setattr(requirements, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"egm needs the package protobuf: pip install 'cellwatt\[abb\]'"):
        streams()
    with pytest.raises(ConfigError, match="web needs the package aiohttp"):
        streams(egm=[])


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"egm": [], "web": []}, "name something in 'egm' or in 'web'"),
        ({"egm": ["joints", "joints"]}, "each once"),
        ({"rate": "100 Hz"}, "whole part"),
        ({"rate": "500 Hz"}, "250 Hz"),
        ({"web_rate": "20 Hz"}, "at most 10 Hz"),
    ],
)
def test_wrong_settings_say_what_is_wrong(changes, why):
    with pytest.raises(ValidationError, match=why):
        AbbSettings.model_validate({"host": "192.0.2.1"} | changes)
