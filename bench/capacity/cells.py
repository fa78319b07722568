"""Cells as they are usual, with emulated devices and a whole daemon."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from capacity.bus import PATIENCE, SITE
from cellwatt.emulation import EmulatorProcess
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session

CELL = "cell"
WARM_UP = 6.0
"""s from the start of a daemon to the first figure."""
_PULSES = {"pulses_per_degree": [1341.4, 1341.4, 1341.4, 1000, 1000, 622], "rated_torque": [120, 120, 60, 15, 15, 10]}


@dataclass(frozen=True, slots=True)
class Device:
    """A device of a cell: its driver, where its emulator listens, and its settings."""

    driver: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    listen: str = "127.0.0.1:0"


@dataclass(frozen=True, slots=True)
class Kind:
    """A usual cell: what it is, its devices, frames a second, and whether it has an arm whose motion is cut."""

    about: str
    devices: Mapping[str, Device]
    frames: float
    arm: bool = True
    latency: float = 0.1


ARM = {"arm": Device("ur", {"rate": "500 Hz"}), "board": Device("power_board", listen="pty")}
KINDS: Mapping[str, Kind] = {
    "arm, 50 Hz": Kind("UR at 500 Hz and power board at 123 Hz, frames at 50 Hz", ARM, 50.0),
    "arm, 500 Hz": Kind("the same, frames at 500 Hz", ARM, 500.0),
    "Yaskawa": Kind(
        "Yaskawa polled over UDP at 50 Hz, frames at 50 Hz",
        {"arm": Device("yaskawa", {"rate": "50 Hz", **_PULSES})},
        50.0,
    ),
    "meter": Kind(
        "SDM630 with 26 values at 10 Hz, frames at 10 Hz",
        {"meter": Device("modbus_meter", {"meter": "eastron_sdm630", "rate": "10 Hz"})},
        10.0,
        arm=False,
        latency=0.3,
    ),
}


@asynccontextmanager
async def emulated(kind: Kind) -> AsyncIterator[dict[str, dict[str, Any]]]:
    """The devices of a cell as processes; gives the sources of its settings."""
    async with AsyncExitStack() as stack:
        sources = {}
        for name, device in kind.devices.items():
            options = [f"meter={device.settings['meter']}"] if "meter" in device.settings else []
            words = [word for option in options for word in ("--option", option)]
            emulator = await stack.enter_async_context(
                EmulatorProcess(device.driver, "--listen", device.listen, *words)
            )
            emulator.be_punctual()
            host, _, port = emulator.address.rpartition(":")
            place = {"port": emulator.address} if device.listen == "pty" else {"host": host, "port": int(port)}
            sources[name] = {"driver": device.driver, **place, **device.settings}
        yield sources


@asynccontextmanager
async def daemon(
    kind: Kind, folder: Path, zenoh: Mapping[str, Any], outlets: Mapping[str, Any] | None = None
) -> AsyncIterator[None]:
    """A whole daemon of a cell, recorded into ``folder/record`` and published."""
    async with emulated(kind) as sources:
        settings = {
            "site": SITE,
            "cell": CELL,
            "sources": sources,
            "frames": {"rate": f"{kind.frames:g} Hz", "latency": f"{kind.latency * 1e3:g} ms"},
            "record": {"folder": str(folder / "record")},
            "zenoh": dict(zenoh),
            **({"stages": {"segment": {}}} if kind.arm else {}),
            **(outlets or {}),
        }
        file = folder / "cell.yaml"
        file.write_text(yaml.safe_dump(settings, sort_keys=False))
        with (folder / "log").open("w") as log:
            command = [sys.executable, "-m", "cellwatt.commands", "run", str(file)]
            process = await asyncio.create_subprocess_exec(*command, stderr=log)
            try:
                await asyncio.sleep(WARM_UP)
                if process.returncode is not None:
                    raise RuntimeError((folder / "log").read_text())
                yield
            finally:
                if process.returncode is None:
                    process.send_signal(signal.SIGTERM)
                await process.wait()


def status(endpoint: str) -> dict[str, Any]:
    """Health of the cell, asked for over Zenoh."""
    with open_session(LinkSettings(mode="client", connect=(endpoint,)), patience=PATIENCE) as session:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            for reply in session.get(f"{CellKeys(SITE, CELL).root}/@/status", timeout=2.0):
                told = json.loads(reply.ok.payload.to_bytes()) if reply.ok is not None else {}
                health: dict[str, Any] = told.get("status", {})
                if "processes" in health:
                    return health
            time.sleep(0.2)
    raise RuntimeError(f"nobody answers at {endpoint}")


def size_of(paths: Sequence[Path]) -> int:
    """Bytes of files, also of one that is renamed meanwhile."""
    total = 0
    for path in paths:
        try:
            total += path.stat().st_size
        except FileNotFoundError:
            total += path.with_name(path.name.removesuffix(".part")).stat().st_size
    return total
