"""The two cells of the demo: a small one with a fault, and one with a device of every driver."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from cellwatt.config import load
from cellwatt.config.places import KeyPath
from cellwatt.errors import ConfigError
from cellwatt.runtime.assemble import prepare

SOMEWHERE = "127.0.0.1:9"
"""Placeholder until an endpoint is chosen."""

SMALL = ("arm", "board", "positioner", "mains")
"""Sources of ``demo.yaml``. The positioner and the mains belong to a second arm, …"""
SPEEDS = {"positioner": 0.8, "mains": 0.8}
"""… which moves at another speed."""
SHAPE = Path(__file__).with_name("arm.urdf")
"""URDF of the emulated arm."""
MODEL = SHAPE.with_name("power.onnx")
"""Trained model of the arm's power; ``bench/models/demo.py`` generates it."""


def every_driver() -> dict[str, dict[str, Any]]:
    """Settings of one emulated device per driver, at its usual rate; each source has the name of its driver."""
    sources: dict[str, dict[str, Any]] = yaml.safe_load(packaged("all-drivers.yaml").read_text())["sources"]
    sources["abb"]["egm_port"] = _free_port(socket.SOCK_DGRAM)
    return sources | {"franka": {"driver": "franka", "host": "127.0.0.1"}}


def usable(sources: Mapping[str, dict[str, Any]], folder: Path) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Return the sources whose drivers can be loaded, and for each other source the reason why not."""
    found, lacking = {}, {}
    for name, source in sources.items():
        try:
            prepare(load(write(folder, {name: source}, SOMEWHERE), {}))
        except ConfigError as error:
            lacking[name] = "; ".join(problem.message for problem in error.problems) or str(error)
        else:
            found[name] = source
    return found, lacking


def write(folder: Path, sources: Mapping[str, Mapping[str, Any]], endpoint: str) -> Path:
    """Write the settings file of a cell that records and publishes these sources; return its path."""
    cell = {
        "site": "demo",
        "cell": "demo",
        "sources": dict(sources),
        "record": {"folder": str(folder), "keep": "1 GB"},
        "zenoh": {"listen": [f"tcp/{endpoint}"]},
    }
    file = folder / "cell.yaml"
    file.write_text(yaml.safe_dump(cell, sort_keys=False))
    return file


def packaged(name: str = "demo.yaml") -> Path:
    """Path of an example settings file, in the package or in examples/ of a checkout."""
    found = Path(str(files("cellwatt"))) / "examples" / name
    return found if found.exists() else Path(__file__).resolve().parents[3] / "examples" / name


def environment(folder: Path, endpoint: str, page: str, settings: Mapping[KeyPath, Any]) -> dict[str, str]:
    """Environment variables for ``demo.yaml``; ``settings`` are the addresses of the emulators, by key path.

    ``endpoint`` and ``page`` are the addresses of the bus and of the cell's page, host:port.
    """
    variables = dict(os.environ, CELLWATT_DEMO_FOLDER=str(folder), CELLWATT_DEMO_ENDPOINT=f"tcp/{endpoint}")
    variables |= {"CELLWATT_DEMO_MODEL": str(MODEL), "CELLWATT_DEMO_SHAPE": str(SHAPE), "CELLWATT_DEMO_PAGE": page}
    variables["CELLWATT_DEMO_DESCRIPTION"] = str(SHAPE.parent)
    for (_, name, key), value in settings.items():
        variables[f"CELLWATT_DEMO_{str(name).upper()}_{str(key).upper()}"] = str(value)
    return variables


def free_endpoint() -> str:
    """A free TCP address of this host."""
    return f"127.0.0.1:{_free_port(socket.SOCK_STREAM)}"


def _free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
