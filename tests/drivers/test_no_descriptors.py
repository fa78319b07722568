"""A PC that has no file descriptor left is a connection that fails, not a driver that is broken."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import aiohttp  # noqa: F401  # drivers import their libraries when they connect, which takes descriptors
import asyncua  # noqa: F401
import can.interfaces.slcan  # noqa: F401
import pymodbus.client  # noqa: F401
import pytest

import cellwatt.outlets.opc_ua.arrays  # noqa: F401
from cellwatt.driver import Driver
from cellwatt.errors import ConnectError
from cellwatt_drivers.abb import AbbDriver
from cellwatt_drivers.can_sensor import CanSensorDriver
from cellwatt_drivers.franka import FrankaDriver
from cellwatt_drivers.kinova import KinovaDriver
from cellwatt_drivers.modbus_meter import ModbusMeterDriver
from cellwatt_drivers.opc_ua import OpcUaDriver
from cellwatt_drivers.power_board import PowerBoardDriver
from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver
from cellwatt_drivers.ur import UrDriver
from cellwatt_drivers.yaskawa import YaskawaDriver

from .inlet import CollectingInlet

HOST = {"host": "127.0.0.1"}


@contextmanager
def no_descriptor_left() -> Iterator[None]:
    free = os.open(os.devnull, os.O_RDONLY)
    os.close(free)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (free, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize(
    ("driver", "settings"),
    [
        (AbbDriver, HOST | {"web": []}),
        (AbbDriver, HOST | {"egm": []}),
        (CanSensorDriver, {"sensor": "ivt_s", "interface": "slcan", "channel": os.devnull}),
        (FrankaDriver, HOST),
        (KinovaDriver, HOST),
        (ModbusMeterDriver, HOST | {"meter": "eastron_sdm630"}),
        (ModbusMeterDriver, {"line": os.devnull, "meter": "eastron_sdm630"}),
        (OpcUaDriver, HOST | {"model": "opc_40010"}),
        (PowerBoardDriver, {"port": os.devnull}),
        (ScpiAnalyzerDriver, HOST),
        (ScpiAnalyzerDriver, {"serial": os.devnull}),
        (UrDriver, HOST),
        (YaskawaDriver, HOST | {"pulses_per_degree": [1000.0] * 6}),
    ],
)
async def test_it_is_a_connection_that_fails(driver: type[Driver[Any]], settings: dict[str, object]) -> None:
    made = driver("device", driver.Settings.model_validate(settings), CollectingInlet())
    with no_descriptor_left(), pytest.raises(ConnectError):
        await made.run()
