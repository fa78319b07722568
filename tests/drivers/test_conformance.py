"""Every driver keeps the contract: a driver of this repository is one more line here."""

from __future__ import annotations

import importlib
import os
import re
import resource
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from cellwatt.errors import ConnectError
from cellwatt.testing import DriverConformance, Rig
from cellwatt_drivers.abb import AbbDriver
from cellwatt_drivers.abb.emulated_robot import EmulatedRobot
from cellwatt_drivers.abb.wire import decode
from cellwatt_drivers.can_sensor import CanSensorDriver
from cellwatt_drivers.franka import FrankaDriver
from cellwatt_drivers.kinova import KinovaDriver
from cellwatt_drivers.modbus_meter import ModbusMeterDriver
from cellwatt_drivers.opc_ua import OpcUaDriver
from cellwatt_drivers.power_board import PowerBoardDriver
from cellwatt_drivers.power_board.emulator import PowerBoardEmulator
from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver
from cellwatt_drivers.ur import UrDriver
from cellwatt_drivers.yaskawa import YaskawaDriver
from tests.patience import PATIENCE

from .abb.rig import free_port
from .inlet import CollectingInlet
from .running import Steady

RTDE = re.compile(
    rb"(?:\x00\x05V\x00\x02|\x00\x03v|..O.{8}[a-zA-Z0-9_,]+|\x00\x03S|\x00\x03P)*",
    re.DOTALL,
)
HSES_READS = re.compile(rb"YERC\x20\x00\x00\x00\x03\x01\x00.{5}9{8}.{5}\x01\x00\x00", re.DOTALL)
SCPI = re.compile(
    rb"(?:(?:\*IDN\?|SYST:ERR\?|CHAN1:MEAS:FUNC\?|CHAN1:MEAS:DATA\?|CHAN1:MEAS:FORM ASC|CHAN1:MEAS:FUNC [A-Z,]+)\n)*"
)
MODBUS_READS = re.compile(rb"(?:..\x00\x00\x00\x06.[\x03\x04].{4})*", re.DOTALL)
SLCAN = re.compile(rb"(?:(?:C|S\d|O|L)\r)*")
GETS = re.compile(rb"(?:GET /(?:rw|logout)[^\r\n]* HTTP/1\.1\r\n(?:[^\r\n]+\r\n)*\r\n)*")
RATED = [200.0, 200.0, 100.0, 2.0, 2.0, 2.0]
ARM = {"pulses_per_degree": [1000.0] * 6, "rated_torque": RATED, "status_rate": "10 Hz", "silence": "500 ms"}
PULSES = {"pulses_per_degree": ",".join(["1000"] * 6), "rated_torque": ",".join(map(str, RATED)), "answer_ms": "0"}
OPC_UA = {"model": "opc_40010", "rate": "20 Hz", "publish": "50 ms", "timeout": "3 s"}
METER = {"meter": "eastron_sdm630", "rate": "20 Hz", "timeout": "200 ms", "silence": "1 s"}


EGM = free_port()
ABB = {"egm_port": EGM, "bind": "127.0.0.1", "tls": False, "web_rate": "5 Hz", "timeout": "500 ms"}


OPC_UA_READS = {428, 446, 452, 461, 467, 473, 527, 533, 554, 631, 751, 787, 826}
"""Encoding ids of the requests that may be sent: none of them is Write (673), Call (712) or HistoryUpdate (700)."""


def opc_ua(data: bytes) -> bool:
    """Whether all messages of a connection without encryption are hellos or requests that read."""
    while data:
        kind, size = data[:4], struct.unpack_from("<I", data, 4)[0]
        if kind == b"OPNF":  # three byte strings, the first of which is the policy
            policy = struct.unpack_from("<i", data, 12)[0]
            at = 16 + policy + 8 + 8
        else:
            at = 24
        if kind != b"HELF" and struct.unpack_from("<BBH", data, at) not in {(1, 0, n) for n in OPC_UA_READS}:
            return False
        data = data[size:]
    return True


class TestConformance(DriverConformance):
    rigs = tuple(
        replace(rig, patience=PATIENCE)
        for rig in (
            Rig(UrDriver, {"timeout": "500 ms"}, may_send=RTDE.fullmatch, warm_up=150),
            Rig(YaskawaDriver, ARM, "udp", HSES_READS.fullmatch, options=PULSES, accuracy=0.1),
            Rig(PowerBoardDriver, {"silence": "500 ms"}, "pty", address="pty"),
            Rig(ScpiAnalyzerDriver, {"rate": "50 Hz", "timeout": "300 ms"}, may_send=SCPI.fullmatch),
            Rig(ModbusMeterDriver, METER, may_send=MODBUS_READS.fullmatch),
            Rig(KinovaDriver, {"timeout": "200 ms"}, may_send=MODBUS_READS.fullmatch),
            Rig(CanSensorDriver, {"sensor": "ivt_s", "silence": "500 ms"}, "pty", SLCAN.fullmatch, address="pty"),
            Rig(FrankaDriver, {"timeout": "500 ms"}, None, address="127.0.0.7:1337", warm_up=100),
            Rig(OpcUaDriver, OPC_UA, may_send=opc_ua, options={"rate": "20"}),
            Rig(AbbDriver, ABB, may_send=GETS.fullmatch, options={"egm": f"127.0.0.1:{EGM}"}, warm_up=50),
        )
    )


@contextmanager
def no_descriptor_left() -> Iterator[None]:
    free = os.open(os.devnull, os.O_RDONLY)
    os.close(free)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (free, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


@pytest.mark.parametrize("rig", TestConformance.rigs, ids=lambda rig: rig.driver.__name__)
async def test_a_pc_without_a_free_descriptor_is_a_connection_that_fails(rig: Rig) -> None:
    for module in (*rig.driver.libraries, "cellwatt_drivers.can_sensor.slcan", "cellwatt.outlets.opc_ua.arrays"):
        importlib.import_module(module)  # which drivers do when they connect, and which takes descriptors
    driver = rig.make(os.devnull if rig.address == "pty" else "127.0.0.1:9", CollectingInlet())
    with no_descriptor_left(), pytest.raises(ConnectError):
        await driver.run()


def test_devices_of_a_recording_that_lacks_what_they_give_say_0():
    robot = EmulatedRobot(Steady({}), 7, 6, 0.004)
    assert list(decode(robot.packet(3, 1, 0.0, False)).message.feedBack.joints.joints) == [0.0] * 6
    board = PowerBoardEmulator(Steady({"supply.voltage": 0.0}), "pty")
    assert not board._phase_values(np.zeros(2)).any()
