"""Certificates and configurations of two plants and headquarters, made by the commands of docs/plants.md."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
from contextlib import chdir
from pathlib import Path
from typing import Any

import yaml

from cellwatt.commands.secure import command
from tests.calling import called
from tests.daemon.outlets.zenoh.fake_cell import CELL

from .network import PLANTS, PORT, hq_address

ROOT = Path(__file__).resolve().parents[5]
HEADQUARTERS, PLANT, HQ_ROUTER, PLANT_ROUTER = re.findall(
    r"```sh\n(.*?)```", (ROOT / "docs" / "plants.md").read_text(), re.DOTALL
)[:4]
"""The page's commands for headquarters and a plant, and those that start their routers."""


def make(folder: Path) -> None:
    """Run the page's commands for headquarters and each plant, with the addresses that they have here."""
    hosts = " ".join(f"--host {host}" for host in (*map(hq_address, PLANTS), "127.0.0.1"))
    _run(HEADQUARTERS.replace("--host hq.example.com", hosts), folder)
    shutil.copy(ROOT / "examples" / "plants" / "hq.json5", folder / "hq")
    for n in PLANTS:
        _run(PLANT.replace("plant-1", f"plant-{n}").replace("192.0.2.10", "10.88.0.1"), folder)


def _run(commands: str, folder: Path) -> None:
    with chdir(folder):
        for line in commands.splitlines():
            words = shlex.split(line)
            if words[0] == "cd":
                os.chdir(words[1])
            elif words[0] == "cellwatt":
                called(command, *words[2:])
            else:
                subprocess.run(line, shell=True, check=True)


def uplink(n: int) -> dict[str, Any]:
    """What a plant's router needs beside the file that ``cellwatt secure`` wrote, by path."""
    here = PLANT_ROUTER.replace("hq.example.com", hq_address(n)).replace("plant-1", f"plant-{n}")
    return {path: json.loads(text) for path, text in re.findall(r"--cfg '([\w/]+):(.*?)'", here)}


def cell_settings(folder: Path, n: int) -> dict[str, Any]:
    """The ``zenoh:`` settings of a plant's cell, with paths from the root."""
    return _absolute(folder / f"plant-{n}", CELL)


def viewer_settings(folder: Path, name: str) -> dict[str, Any]:
    """The ``zenoh:`` settings of a viewer at headquarters, with paths from the root."""
    return _absolute(folder / "hq", name) | {"connect": [f"tls/127.0.0.1:{PORT}"]}


def _absolute(at: Path, member: str) -> dict[str, Any]:
    settings: dict[str, Any] = yaml.safe_load((at / member / "zenoh.yaml").read_text())["zenoh"]
    settings["tls"] = {option: str(at / path) for option, path in settings["tls"].items()}
    if "sign" in settings:
        settings["sign"] = str(at / settings["sign"])
    return settings
