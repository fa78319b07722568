"""The demo's cell: its settings file, addresses, and models of its arm."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from cellwatt.config.places import KeyPath

SOURCES = ("arm", "board", "positioner", "mains")
"""Sources of ``demo.yaml``. The positioner and the mains belong to a second arm, …"""
SPEEDS = {"positioner": 0.8, "mains": 0.8}
"""… which moves at another speed."""
SHAPE = Path(__file__).with_name("arm.urdf")
"""URDF of the emulated arm."""
MODEL = SHAPE.with_name("power.onnx")
"""Trained model of the arm's power; ``bench/models/demo.py`` generates it."""


def packaged() -> Path:
    """Path of the demo's settings file, in the package or in examples/ of a checkout."""
    found = Path(str(files("cellwatt"))) / "examples" / "demo.yaml"
    return found if found.exists() else Path(__file__).resolve().parents[3] / "examples" / "demo.yaml"


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
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"
