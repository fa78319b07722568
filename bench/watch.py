"""Draw docs/pictures/watch.svg and watch.png: the dashboard on the demo's cell, with a spring on the arm's elbow.

The devices are emulated; all else is as at a cell. It needs Chromium for the PNG, and takes two minutes.
"""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from cellwatt.demo.cells import free_endpoint, shape_file
from cellwatt.live.app import LiveApp
from cellwatt.live.state import LiveCell
from cellwatt.live.view import Look
from cellwatt.outlets.zenoh.heard import await_cell
from cellwatt.subscriber import LinkSettings, Message, Subscriber

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs/pictures"
SIZE = (100, 31)
WIDTH = 1200
"""Pixels of the PNG."""
HOOKED = 50
"""s after the start of the emulators at which the spring is hooked on."""
PATIENCE = 240.0
WANT = ("interval", "task", "prediction", "alarm", "health", "frame")


@contextmanager
def process(arguments: list[str], environment: Mapping[str, str], log: Path) -> Iterator[None]:
    """Run a command of cellwatt; end it afterwards."""
    command = [sys.executable, "-m", "cellwatt.commands", *arguments]
    with log.open("w") as out, subprocess.Popen(command, env=environment, stdout=out, stderr=out) as running:
        try:
            yield
        finally:
            running.terminate()


@contextmanager
def demo_cell(folder: Path, fault: str, page: str = "") -> Iterator[LinkSettings]:
    """The demo's cell, with a fault; ``page`` is the address of its page, any where it is empty."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    for name in ("demo.yaml", "demo-reference.yaml"):
        shutil.copy(ROOT / "examples" / name, folder)
    told = {"ENDPOINT": endpoint, "FOLDER": folder / "rec", "MODEL": ROOT / "daemon/cellwatt/demo/power.onnx"}
    told |= {"PAGE": page or free_endpoint(), "SHAPE": shape_file()}
    environment = {**os.environ, **{f"CELLWATT_DEMO_{name}": str(value) for name, value in told.items()}}
    live = folder / "live.yaml"
    emulate = ["emulate", "--cell", str(folder / "demo.yaml"), "--write", str(live), "--fault", fault]
    with process(emulate, environment, folder / "emulate.log"):
        while not live.exists():
            time.sleep(0.1)
        link = LinkSettings(mode="client", connect=(endpoint,))
        with process(["run", str(live)], environment, folder / "run.log"):
            await_cell(link, "demo", "demo", PATIENCE)
            yield link


async def drawn(site: str, name: str, link: LinkSettings, look: Look) -> str:
    """The dashboard of a cell as SVG, once an alarm names a joint and a cycle with the fault is on it."""
    cell = LiveCell()
    with Subscriber(site, name, link, want=WANT) as subscriber:

        def messages() -> Iterator[Message | None]:
            while True:
                try:
                    yield subscriber.receive(1.0)
                except TimeoutError:
                    yield None

        app = LiveApp(messages(), look, cell)
        async with app.run_test(size=SIZE):
            end = time.monotonic() + PATIENCE
            while not any(alarm["joint"] for alarm in cell.alarms.values()):
                if time.monotonic() > end:
                    raise SystemExit("no alarm named a joint")
                await asyncio.sleep(0.1)
            await asyncio.sleep(6.0)
            app.draw()
            await asyncio.sleep(0.3)
            svg = app.export_screenshot(title="cellwatt watch cell.yaml")
            app.exit()
    return _without_hosts(svg)


def _without_hosts(svg: str) -> str:
    """The picture without fonts and links from elsewhere."""
    svg = re.sub(r"@font-face \{.*?\}|<!--.*?-->", "", svg, flags=re.DOTALL)
    return re.sub(r"^\s+\n", "", svg.replace("Fira Code", "DejaVu Sans Mono"), flags=re.MULTILINE)


def png(svg: Path, out: Path) -> None:
    """Draw the SVG with Chromium."""
    found = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg.read_text())
    assert found is not None
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text(f'<body style="margin:0"><img src="{svg}" style="display:block" width="{WIDTH}">')
        screenshot(page, out, round(WIDTH * float(found[2]) / float(found[1])))


def screenshot(page: Path, out: Path, height: int) -> None:
    """Draw the top of a page with Chromium, ``height`` pixels of it."""
    with tempfile.TemporaryDirectory() as folder:
        quiet = (
            "headless no-sandbox disable-gpu no-first-run disable-sync disable-background-networking hide-scrollbars"
        )
        options = [f"--{option}" for option in quiet.split()]
        options += ["--allow-file-access-from-files", "--default-background-color=00000000"]
        options += ["--virtual-time-budget=10000"]  # the scripts of the page have drawn it
        options += [f"--user-data-dir={folder}", f"--screenshot={out}", f"--window-size={WIDTH},{height}"]
        subprocess.run(["chromium", *options, str(page)], check=True, capture_output=True)


def main() -> None:
    """Draw the pictures."""
    with tempfile.TemporaryDirectory() as folder, demo_cell(Path(folder), f"spring:joint=3,at={HOOKED}s") as link:
        svg = asyncio.run(drawn("demo", "demo", link, Look(power="board.supply.power")))
    (PICTURES / "watch.svg").write_text(svg)
    png(PICTURES / "watch.svg", PICTURES / "watch.png")


if __name__ == "__main__":
    main()
