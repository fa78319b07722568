"""Certificates and configurations of two plants and headquarters, as docs/plants.md makes them."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import yaml

from cellwatt.secure.folder import Folder, Member

from .network import PLANTS, PORT, hq_address

ROOT = Path(__file__).resolve().parents[5]
CELL = "weld-3"
"""Name of the cell in each plant."""


def make(folder: Path) -> None:
    """Make the authorities of headquarters and of each plant, all certificates, and the configurations of routers."""
    hq = Folder.create(folder / "hq", "hq")
    hq.add(Member("hq-router", "router", (*map(hq_address, PLANTS), "127.0.0.1")))
    for name in (*(f"plant-{n}-router" for n in PLANTS), "recorder", "board"):
        hq.add(Member(name, "viewer"))
    shutil.copy(ROOT / "examples" / "plants" / "hq.json5", folder / "hq" / "hq.json5")
    for n in PLANTS:
        at = folder / f"plant{n}"
        plant = Folder.create(at, f"plant-{n}")
        plant.add(Member("router", "router", ("10.88.0.1",)))
        plant.add(Member(CELL, "cell"))
        plant.add(Member("hq-router", "viewer"))
        uplink = at / f"plant-{n}-router"
        shutil.copytree(folder / "hq" / uplink.name, uplink)
        authorities = (at / "router" / "ca.pem").read_bytes() + (uplink / "ca.pem").read_bytes()
        (at / "both-ca.pem").write_bytes(authorities)


def uplink(n: int) -> dict[str, Any]:
    """What a plant's router needs beside the file that ``cellwatt secure`` wrote, by path."""
    at = "transport/link/tls"
    return {
        "connect/endpoints": [f"tls/{hq_address(n)}:{PORT}"],
        f"{at}/root_ca_certificate": "both-ca.pem",
        f"{at}/connect_certificate": f"plant-{n}-router/cert.pem",
        f"{at}/connect_private_key": f"plant-{n}-router/key.pem",
    }


def cell_settings(folder: Path, n: int) -> dict[str, Any]:
    """The ``zenoh:`` settings of a plant's cell, with paths from the root."""
    return _absolute(folder / f"plant{n}", CELL)


def viewer_settings(folder: Path, name: str) -> dict[str, Any]:
    """The ``zenoh:`` settings of a viewer at headquarters, with paths from the root."""
    return _absolute(folder / "hq", name) | {"connect": [f"tls/127.0.0.1:{PORT}"]}


def _absolute(at: Path, member: str) -> dict[str, Any]:
    settings: dict[str, Any] = yaml.safe_load((at / member / "zenoh.yaml").read_text())["zenoh"]
    settings["tls"] = {option: str(at / path) for option, path in settings["tls"].items()}
    if "sign" in settings:
        settings["sign"] = str(at / settings["sign"])
    return settings
