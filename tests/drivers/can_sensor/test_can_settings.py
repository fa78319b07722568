from __future__ import annotations

import pytest

from cellwatt.errors import ConfigError
from cellwatt_drivers.can_sensor import CanSensorDriver, CanSensorSettings

from ..inlet import CollectingInlet

GOOD = {"sensor": "ivt_s"}


def make(**changes):
    return CanSensorDriver("battery", CanSensorSettings.model_validate(GOOD | changes), CollectingInlet())


def test_streams_and_rates_are_chosen():
    found = make(read=["energy", "current"], rates={"current": "1 kHz"}).streams
    assert [(s.name, round(s.rate, 1)) for s in found] == [("energy", 33.3), ("current", 1000.0)]
    assert (found[0].channels[0].unit, found[0].channels[0].method) == ("J", "hold")
    with pytest.raises(ConfigError, match=r"read: the map of IVT-S has no amps \(it has: current"):
        make(read=["amps"])
    with pytest.raises(ConfigError, match=r"rates: the map of IVT-S has no amps"):
        make(rates={"amps": "1 Hz"})


def test_a_bitrate_from_the_environment_is_a_text():
    wired = GOOD | {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": "500000"}
    assert CanSensorSettings.model_validate(wired).bitrate == 500_000
