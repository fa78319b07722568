"""Wrong settings of each driver say what is wrong."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from cellwatt_drivers.abb import AbbSettings
from cellwatt_drivers.can_sensor import CanSensorSettings
from cellwatt_drivers.franka.driver import FrankaSettings
from cellwatt_drivers.kinova import KinovaSettings
from cellwatt_drivers.modbus_meter import ModbusMeterSettings
from cellwatt_drivers.opc_ua import OpcUaSettings
from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerSettings
from cellwatt_drivers.ur import UrDriver
from cellwatt_drivers.yaskawa import YaskawaSettings

HOST = {"host": "192.0.2.1"}
IVT_S = {"sensor": "ivt_s"}
PAC3200 = {"meter": "siemens_pac3200"}
PORT = {"interface": "slcan", "channel": "/dev/ttyACM0"}
TAG = HOST | {"tags": {"supply.power": {"node": "ns=2;s=P", "unit": "W"}}}
MOTOMAN = HOST | {"pulses_per_degree": [1000.0] * 6}


@pytest.mark.parametrize(
    ("settings", "url"),
    [(AbbSettings, "https://[fd00::1]:443"), (OpcUaSettings, "opc.tcp://[fd00::1]:4840")],
)
def test_an_address_of_ipv6_stands_in_brackets_in_a_url(settings, url):
    assert settings.model_validate(({} if settings is AbbSettings else TAG) | {"host": "fd00::1"}).url == url


@pytest.mark.parametrize(
    ("settings", "found", "why"),
    [
        (AbbSettings, HOST | {"egm": [], "web": []}, "name something in 'egm' or in 'web'"),
        (AbbSettings, HOST | {"egm": ["joints", "joints"]}, "each once"),
        (AbbSettings, HOST | {"rate": "100 Hz"}, "whole part"),
        (AbbSettings, HOST | {"web_rate": "20 Hz"}, "less than or equal to 10"),
        (CanSensorSettings, {}, "either 'sensor'"),
        (CanSensorSettings, IVT_S | {"map": __file__}, "either 'sensor'"),
        (CanSensorSettings, IVT_S | {"bitrate": 500000}, "are for slcan"),
        (CanSensorSettings, IVT_S | {"interface": "slcan"}, "path of a serial port"),
        (CanSensorSettings, IVT_S | PORT | {"bitrate": 123}, "expected one of 10000"),
        (FrankaSettings, HOST | {"read": []}, "at least one"),
        (FrankaSettings, HOST | {"rate": "2 kHz"}, "1000 Hz or a whole part"),
        (KinovaSettings, HOST | {"read": []}, "at least one"),
        (KinovaSettings, HOST | {"read": ["tool"]}, "add 'joints'"),
        (KinovaSettings, HOST | {"rate": "1 kHz"}, "less than or equal to 500"),
        (ModbusMeterSettings, PAC3200, "either 'host' or 'line'"),
        (ModbusMeterSettings, HOST | PAC3200 | {"line": "/dev/ttyUSB0"}, "either 'host' or 'line'"),
        (ModbusMeterSettings, HOST, "either 'meter'"),
        (ModbusMeterSettings, PAC3200 | {"line": "COM3"}, "path of a serial port"),
        (OpcUaSettings, TAG | {"tags": {}}, "write 'model'"),
        (OpcUaSettings, TAG | {"model": "opc_40010", "map": __file__}, "not both"),
        (OpcUaSettings, TAG | {"security": "sign"}, "needs 'certificate' and 'key'"),
        (OpcUaSettings, TAG | {"publish": "3 s"}, "'silence' is at least twice 'publish'"),
        (
            OpcUaSettings,
            TAG | {"tags": {"a.x": {"node": "ns=plc;s=P", "unit": "W"}}},
            "no prefix 'plc' in 'namespaces'",
        ),
        (OpcUaSettings, TAG | {"tags": {"a.x": {"node": "i=1", "unit": "kWatt"}}}, "'kWatt' is not a unit"),
        (OpcUaSettings, TAG | {"user_key": __file__}, "'user_certificate'"),
        (OpcUaSettings, TAG | {"user_certificate": __file__, "user_key": __file__}, "'user_certificate'"),
        (ScpiAnalyzerSettings, {}, "either 'host' or 'serial'"),
        (ScpiAnalyzerSettings, HOST | {"serial": "/dev/ttyACM0"}, "either 'host' or 'serial'"),
        (ScpiAnalyzerSettings, HOST | {"integrate": True}, "add WH to functions"),
        (ScpiAnalyzerSettings, HOST | {"model": "lmg600", "functions": ["P", "WH"]}, "lmg600 has no WH; it has: URMS"),
        (ScpiAnalyzerSettings, HOST | {"model": "hmc8015", "element": "2"}, "hmc8015 has no element 2; it has: 1"),
        (ScpiAnalyzerSettings, HOST | {"model": "lmg600", "element": "sigma"}, "lmg600 has no element sigma"),
        (UrDriver.Settings, HOST | {"rate": "1 kHz"}, "less than or equal to 500"),
        (UrDriver.Settings, HOST | {"channels": ["actual_qq"]}, "did you mean 'actual_q'"),
        (UrDriver.Settings, HOST | {"channels": ["actual_q", "joint_2.position"]}, "joint_2.position is chosen twice"),
        (YaskawaSettings, HOST | {"pulses_per_degree": []}, "one value for each of the 6 axes"),
        (YaskawaSettings, HOST | {"pulses_per_degree": [1000.0] * 5 + [0.0]}, "no value may be zero"),
        (YaskawaSettings, MOTOMAN | {"rated_torque": [10.0]}, "rated_torque has 1 entries for 6 axes"),
        (YaskawaSettings, MOTOMAN | {"coupling": [[1.0] * 6] * 5}, "coupling has 5 entries"),
        (YaskawaSettings, MOTOMAN | {"coupling": [[1.0] * 5] * 6}, "6 rows of 6 values"),
        (YaskawaSettings, MOTOMAN | {"read": ["position", "alarm"]}, "add 'status'"),
        (YaskawaSettings, MOTOMAN | {"status_rate": "60 Hz"}, "above rate"),
    ],
)
def test_wrong_settings_say_what_is_wrong(settings, found, why):
    with pytest.raises(ValidationError, match=why):
        settings.model_validate(found)
