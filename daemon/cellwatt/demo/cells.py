"""The cells that the demo knows: a small one with a fault, and one with a device of every driver."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from cellwatt.config import load
from cellwatt.demo.power import model_file
from cellwatt.errors import ConfigError
from cellwatt.runtime.assemble import prepare

NOWHERE = {"pty": "/dev/ttyUSB0"}
"""Stands for the address of a device while nothing listens yet, by where its emulator will; else ``SOMEWHERE``."""
SOMEWHERE = "127.0.0.1:9"

Place = Callable[[str], Mapping[str, Any]]


def _host_and_port(address: str) -> Mapping[str, Any]:
    host, _, port = address.rpartition(":")
    return {"host": host, "port": int(port)}


def _serial_port(address: str) -> Mapping[str, Any]:
    return {"port": address}


@dataclass(frozen=True)
class Device:
    """An emulated device, and the source that reads it.

    The emulator listens at ``listen`` with ``options``, its arm moves at ``speed``; ``place`` turns the emulator's
    address into settings, ``settings`` are the others.
    """

    driver: str
    listen: str = "127.0.0.1:0"
    speed: float = 1.0
    options: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    place: Place = _host_and_port

    def arguments(self, epoch: float, seed: int) -> tuple[str, ...]:
        """Arguments of ``cellwatt emulate`` after the driver's name."""
        pairs = (word for key, value in self.options.items() for word in ("--option", f"{key}={value}"))
        known = ("--listen", self.listen, "--epoch", str(epoch), "--speed", str(self.speed), "--seed", str(seed))
        return (*known, *pairs)


PULSES = {"pulses_per_degree": [1341.4, 1341.4, 1341.4, 1000, 1000, 622], "rated_torque": [120, 120, 60, 15, 15, 10]}

SMALL: Mapping[str, Device] = {
    "arm": Device("ur"),
    "board": Device("power_board", "pty", place=_serial_port),
    "positioner": Device("yaskawa", speed=0.8, options={"answer_ms": "2"}, settings=PULSES),
    "mains": Device("scpi_analyzer", speed=0.8),
}
"""The devices of ``demo.yaml`` by source; the positioner and the mains are those of a second arm."""

FCI_PORT = 1337
"""pylibfranka knows no other."""


def every_driver() -> Mapping[str, Device]:
    """One device per driver, named like the driver, at its usual rates."""
    packets = _free_udp_port()
    return {
        "ur": Device("ur"),
        "yaskawa": Device("yaskawa", options={"answer_ms": "2"}, settings=PULSES),
        "abb": Device(
            "abb",
            options={"egm": f"127.0.0.1:{packets}"},
            settings={"egm_port": packets, "bind": "127.0.0.1", "tls": False},
        ),
        "franka": Device("franka", f"{_free_host(FCI_PORT)}:{FCI_PORT}", options={"realtime": "1"}, place=_host_only),
        "kinova": Device("kinova"),
        "power_board": Device("power_board", "pty", place=_serial_port),
        "scpi_analyzer": Device("scpi_analyzer"),
        "modbus_meter": Device("modbus_meter", settings={"meter": "eastron_sdm630", "rate": "5 Hz"}),
        "can_sensor": Device("can_sensor", "pty", settings={"sensor": "ivt_s"}, place=_adapter),
    }


def usable(devices: Mapping[str, Device], folder: Path) -> tuple[dict[str, Device], dict[str, str]]:
    """The devices whose drivers can be loaded here, and the reason for each of the others."""
    found, lacking = {}, {}
    for name, device in devices.items():
        try:
            address = NOWHERE.get(device.listen, SOMEWHERE)
            prepare(load(write(folder, {name: (device, address)}, SOMEWHERE), {}))
        except ConfigError as error:
            lacking[name] = "; ".join(problem.message for problem in error.problems) or str(error)
        else:
            found[name] = device
    return found, lacking


def write(folder: Path, devices: Mapping[str, tuple[Device, str]], endpoint: str) -> Path:
    """The settings file of a cell with these devices at these addresses, recorded and published."""
    sources = {name: {"driver": d.driver, **d.settings, **d.place(address)} for name, (d, address) in devices.items()}
    cell = {
        "site": "demo",
        "cell": "demo",
        "sources": sources,
        "record": {"folder": str(folder), "keep": "1 GB"},
        "zenoh": {"listen": [f"tcp/{endpoint}"]},
    }
    file = folder / "cell.yaml"
    file.write_text(yaml.safe_dump(cell, sort_keys=False))
    return file


def packaged() -> Path:
    """``demo.yaml``: packaged, or in examples/ of a checkout."""
    found = Path(str(files("cellwatt"))) / "examples" / "demo.yaml"
    return found if found.exists() else Path(__file__).resolve().parents[3] / "examples" / "demo.yaml"


def environment(folder: Path, addresses: Mapping[str, str], endpoint: str) -> dict[str, str]:
    """The environment variables that ``demo.yaml`` reads."""
    told = dict(os.environ, CELLWATT_DEMO_FOLDER=str(folder), CELLWATT_DEMO_ENDPOINT=f"tcp/{endpoint}")
    told["CELLWATT_DEMO_MODEL"] = str(model_file())
    for name, address in addresses.items():
        for key, value in SMALL[name].place(address).items():
            told[f"CELLWATT_DEMO_{name.upper()}_{key.upper()}"] = str(value)
    return told


def free_endpoint() -> str:
    """A free TCP address of this host."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def _free_host(port: int) -> str:
    """A loopback address at which a port is free: some libraries support only one port."""
    for last in range(2, 255):
        with socket.socket() as probe:
            try:
                probe.bind((f"127.0.77.{last}", port))
            except OSError:
                continue
            return f"127.0.77.{last}"
    raise ConfigError(f"port {port} is taken at all of 127.0.77.2 to 127.0.77.254; end what listens there")


def _host_only(address: str) -> Mapping[str, Any]:
    return {"host": address.rpartition(":")[0]}


def _adapter(address: str) -> Mapping[str, Any]:
    return {"interface": "slcan", "channel": address}
