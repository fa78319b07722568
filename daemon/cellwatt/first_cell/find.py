"""Devices for a first settings file: serial ports of this PC, and who answers at an address that the user gives."""

from __future__ import annotations

import asyncio
import grp
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from serial.tools.list_ports import comports

from cellwatt.batch import Batch
from cellwatt.config import SourceConfig
from cellwatt.runtime.examine import Examination, examine

BY_ID = Path("/dev/serial/by-id")
"""Names of serial ports that stay the same when an adapter is plugged in elsewhere."""


@dataclass(frozen=True, slots=True)
class SerialPort:
    """A serial port of this PC; ``trouble`` is why it cannot be opened now, and what to do."""

    path: str
    title: str
    trouble: str = ""


def serial_ports() -> list[SerialPort]:
    """Serial ports with a device behind them, by their lasting names. None of them is opened."""
    lasting = {os.path.realpath(link): str(link) for link in _links()}
    return [
        SerialPort(lasting.get(os.path.realpath(port.device), port.device), port.description, trouble(port.device))
        for port in sorted(comports())
    ]


def _links() -> Iterator[Path]:
    return BY_ID.iterdir() if BY_ID.is_dir() else iter(())


def trouble(device: str) -> str:
    """Why a port cannot be opened now, and what to do; nothing where it can, as far as is seen without opening it."""
    try:
        status = Path(device).stat()
    except OSError:
        return "gone"
    if not os.access(device, os.R_OK | os.W_OK):
        return f"not permitted: sudo usermod -aG {_group(status.st_gid)} $USER, then log in again"
    return ""


def _group(number: int) -> str:
    try:
        name = grp.getgrgid(number).gr_name
    except KeyError:
        return "dialout"
    return "dialout" if name == "root" else name


def look(source: SourceConfig, seconds: float, patience: float) -> Examination:
    """Ask the device of a source who it is and read it for ``seconds``, read-only."""
    batches: list[Batch] = []
    return asyncio.run(examine(source, seconds, patience, batches))


def told(found: Examination) -> str:
    """Who answered and how fast it is, or why nobody did, in one line."""
    if found.verdict == "failed":
        return "; ".join(found.findings)
    identity = found.status["identity"]
    who = " ".join(filter(None, (identity[key] for key in ("maker", "model", "firmware"))))
    rates = [
        f"{name} {figures['rate_hz']:.0f} Hz" for name, figures in found.status["streams"].items() if figures["rate_hz"]
    ]
    return ", ".join((who, *rates))
