"""The cell of the demo: its settings, what they are filled with, and the files that describe its arm."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from cellwatt.config.places import KeyPath

SOURCES = ("arm", "board", "positioner", "mains")
"""Of ``demo.yaml``; the positioner and the mains are those of a second arm, …"""
SPEEDS = {"positioner": 0.8, "mains": 0.8}
"""… which moves at another speed."""


def packaged() -> Path:
    """``demo.yaml``: packaged, or in examples/ of a checkout."""
    found = Path(str(files("cellwatt"))) / "examples" / "demo.yaml"
    return found if found.exists() else Path(__file__).resolve().parents[3] / "examples" / "demo.yaml"


def shape_file() -> Path:
    """URDF of the emulated arm."""
    return Path(__file__).with_name("arm.urdf")


def model_file() -> Path:
    """Path of the trained model of its power, which ``bench/models/demo.py`` makes."""
    return Path(__file__).with_name("power.onnx")


def environment(folder: Path, endpoint: str, page: str, settings: Mapping[KeyPath, Any]) -> dict[str, str]:
    """The environment variables that ``demo.yaml`` reads, with the settings that lead to the emulators.

    ``endpoint`` and ``page`` are the addresses of the bus and of the cell's page, host:port.
    """
    told = dict(os.environ, CELLWATT_DEMO_FOLDER=str(folder), CELLWATT_DEMO_ENDPOINT=f"tcp/{endpoint}")
    told |= {"CELLWATT_DEMO_MODEL": str(model_file()), "CELLWATT_DEMO_SHAPE": str(shape_file())}
    told["CELLWATT_DEMO_DESCRIPTION"] = str(shape_file().parent)
    told["CELLWATT_DEMO_PAGE"] = page
    for (_, name, key), value in settings.items():
        told[f"CELLWATT_DEMO_{str(name).upper()}_{str(key).upper()}"] = str(value)
    return told


def free_endpoint() -> str:
    """A free TCP address of this host."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"
