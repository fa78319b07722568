"""What the daemon weighs: memory and CPU idle and at work, check time, time to the first frame, a hung neighbour.

    python bench/footprint.py --json

Whole processes, measured from outside. ``hung_neighbour`` compares how late the polls of one controller leave while a
second one answers and while it hangs.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import psutil

from cellwatt.demo.cells import MODEL, SHAPE
from cellwatt.emulation import EmulatorProcess
from cellwatt.record import Recording

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.browser import chromium

CELLWATT = [sys.executable, "-m", "cellwatt.commands"]


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def cell(folder: Path, sources: str, more: str = "", keep: str = "20 GB") -> Path:
    path, record = folder / "cell.yaml", f"record: {{folder: {folder / 'record'}, keep: {keep}}}\n"
    path.write_text(f"site: bench\ncell: bench\nsources:\n{sources}{more}{record}")
    return path


@contextlib.contextmanager
def daemon(path: Path) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen([*CELLWATT, "run", str(path)], stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(30)


def weigh(process: subprocess.Popen[bytes], seconds: float) -> dict[str, float]:
    """CPU share of one core over a span, and memory at its end, of all processes; what they share counts once."""
    parts = family(process.pid)
    before, start = computed(parts), time.monotonic()
    time.sleep(seconds)
    cpu = (computed(parts) - before) / (time.monotonic() - start)
    return {"cpu_percent": round(100 * cpu, 2), "pss_mb": memory(parts), "processes": len(parts)}


def family(pid: int) -> list[psutil.Process]:
    """A process and its children."""
    first = psutil.Process(pid)
    return [first, *first.children(recursive=True)]


def computed(parts: list[psutil.Process]) -> float:
    """Processor time so far, s."""
    times = [p.cpu_times() for p in parts]
    return float(sum(t.user + t.system for t in times))


def memory(parts: list[psutil.Process]) -> float:
    """MB, what several share counted once."""
    return round(sum(p.memory_full_info().pss for p in parts) / 1e6, 1)


def own(part: psutil.Process) -> float:
    """MB that a process has written and shares with none; libraries are shared or not by what else runs on the PC."""
    rollup = Path(f"/proc/{part.pid}/smaps_rollup").read_text()
    return int(rollup.partition("Private_Dirty:")[2].split()[0]) / 1e3


def idle(seconds: float) -> dict[str, float]:
    """All devices down: nobody listens at any address."""
    with tempfile.TemporaryDirectory() as name:
        sources = "".join(f"  arm_{i}: {{driver: ur, host: 127.0.0.1, port: {free_port()}}}\n" for i in range(2))
        sources += f"  meter: {{driver: scpi_analyzer, host: 127.0.0.1, port: {free_port()}}}\n"
        sources += "  board: {driver: power_board, port: /dev/serial/by-id/none}\n"
        with daemon(cell(Path(name), sources)) as process:
            time.sleep(15)
            return weigh(process, seconds)


def with_page(address: str) -> str:
    """Settings of the typical cell's stages, a model among them, and of its page."""
    stages = f"stages:\n  segment: {{arm: arm}}\n  power: {{stage: model, file: {MODEL}, source: arm}}\n"
    return f'robot: demo\n{stages}page: {{listen: "{address}", arms: {{arm: {SHAPE}}}}}\n'


@contextlib.asynccontextmanager
async def typical(shown: bool = False) -> AsyncIterator[subprocess.Popen[bytes]]:
    """A UR at 500 Hz, a power board at 123 Hz and an analyzer at 10 Hz, recorded and published; its daemon.

    ``shown``: also predicted by a model, and looked at in a browser, which is not counted.
    """
    address = f"127.0.0.1:{free_port()}"
    stages = with_page(address) if shown else "stages:\n  segment: {arm: arm}\n"
    async with contextlib.AsyncExitStack() as stack:
        devices = {"arm": "ur", "board": "power_board", "meter": "scpi_analyzer"}
        sources = ""
        for source, driver in devices.items():
            where = "pty" if source == "board" else "127.0.0.1:0"
            device = await stack.enter_async_context(EmulatorProcess(driver, "--listen", where))
            host, _, port = device.address.rpartition(":")
            sources += f"  {source}: {{driver: {driver}, {f'host: {host}, ' if host else ''}port: {port}}}\n"
        name = stack.enter_context(tempfile.TemporaryDirectory())
        process = stack.enter_context(daemon(cell(Path(name), sources, stages)))
        await asyncio.sleep(10)
        if shown:
            page = await (await stack.enter_async_context(chromium())).new_page()
            await page.goto(f"http://{address}/")
            await asyncio.sleep(10)
        yield process


async def weigh_typical(seconds: float, shown: bool = False) -> dict[str, Any]:
    async with typical(shown) as process:
        first = await asyncio.to_thread(weigh, process, seconds / 2)
        second = await asyncio.to_thread(weigh, process, seconds / 2)
    return second | {"growth_mb_per_h": round((second["pss_mb"] - first["pss_mb"]) * 7200 / seconds, 1)}


def check() -> float:
    """Seconds for ``cellwatt check`` on 20 devices."""
    with tempfile.TemporaryDirectory() as name:
        kinds = (
            "{{driver: ur, host: 192.0.2.{}}}",
            "{{driver: scpi_analyzer, host: 192.0.2.{}}}",
            "{{driver: power_board, port: /dev/ttyUSB{}}}",
            "{{driver: yaskawa, host: 192.0.2.{}, read: [torque, status, alarm]}}",
        )
        sources = "".join(f"  device_{i}: {kinds[i % 4].format(i + 1)}\n" for i in range(20))
        path = cell(Path(name), sources)
        start = time.monotonic()
        subprocess.run([*CELLWATT, "check", str(path)], check=True, stdout=subprocess.DEVNULL)
        return time.monotonic() - start


async def first_frame() -> dict[str, float]:
    """From the start of the process, and from the moment the device answered, to the first frame's recording."""
    async with EmulatorProcess("ur", "--listen", "127.0.0.1:0") as arm:
        with tempfile.TemporaryDirectory() as name:
            host, port = arm.address.split(":")
            path = cell(Path(name), f"  arm: {{driver: ur, host: {host}, port: {port}}}\n")
            start = time.time()
            with daemon(path):
                await asyncio.sleep(6)
            recording = Recording.open(Path(name) / "record")
            frame = next(iter(recording.frames()))
            answered = next(e.time for e in recording.events() if e.kind == "connected")
            emitted = int(frame.time[0]) + 0.1e9
            return {
                "after_start_s": round(emitted * 1e-9 - start, 3),
                "after_answer_s": round((emitted - answered) * 1e-9, 3),
            }


async def hung_neighbour(seconds: float) -> dict[str, Any]:
    """Jitter of one controller's samples while another one answers, and while that one hangs."""
    async with (
        EmulatorProcess("yaskawa", "--listen", "127.0.0.1:0", "--option", "answer_ms=2") as good,
        EmulatorProcess("yaskawa", "--listen", "127.0.0.1:0", "--option", "answer_ms=2") as bad,
    ):
        with tempfile.TemporaryDirectory() as name:
            sources = ""
            for source, device in (("good", good), ("bad", bad)):
                host, port = device.address.split(":")
                sources += f"  {source}: {{driver: yaskawa, host: {host}, port: {port}, read: [torque]}}\n"
            with daemon(cell(Path(name), sources)):
                await asyncio.sleep(seconds + 3)
                hung_at = time.time_ns()
                await bad.strike(f"stall:seconds={seconds + 5}s")
                await asyncio.sleep(seconds)
            times = Recording.open(Path(name) / "record").batches("good", "torque").time
    import numpy as np

    def lateness(part: Any) -> dict[str, float]:
        steps = np.abs(np.diff(part) - 20_000_000) * 1e-6
        return {f"p{p:g}_ms": round(float(np.percentile(steps, p)), 3) for p in (50, 99, 99.9)}

    start = times[0] + 2_000_000_000
    return {"answering": lateness(times[(times > start) & (times < hung_at)]), "hung": lateness(times[times > hung_at])}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seconds", type=float, default=30.0)
    a = parser.parse_args()
    os.environ["PYTHONWARNINGS"] = "ignore"
    figures = {
        "idle": idle(a.seconds),
        "typical": asyncio.run(weigh_typical(2 * a.seconds)),
        "page_and_model": asyncio.run(weigh_typical(2 * a.seconds, shown=True)),
        "check_20_devices_s": sorted(round(check(), 3) for _ in range(5)),
        "first_frame": [asyncio.run(first_frame()) for _ in range(3)],
        "hung_neighbour": asyncio.run(hung_neighbour(a.seconds)),
    }
    print(json.dumps(figures) if a.json else json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
