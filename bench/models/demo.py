"""Makes ``examples/demo-power.onnx``: the model of the arm that ``cellwatt demo`` emulates.

    python bench/models/demo.py examples/demo-power.onnx

Records the demo's arm and its board, without the fault, for 40 s and trains on the frames.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import tempfile
import time
from contextlib import AsyncExitStack
from pathlib import Path

from threadpoolctl import threadpool_limits

from cellwatt.demo import cells, processes
from cellwatt.demo.fault import FAULTY
from cellwatt.emulation import EmulatorProcess
from cellwatt_plugins.models.power.demo import demo_robot, train_demo

SECONDS = 40.0


async def record(folder: Path, seconds: float = SECONDS) -> None:
    """Frames of the arm and of the board on its supply."""
    epoch = time.time()
    async with AsyncExitStack() as stack:
        devices = {}
        for seed, name in enumerate(FAULTY, start=len(cells.SMALL)):
            device = cells.SMALL[name]
            emulator = EmulatorProcess(device.driver, *device.arguments(epoch, seed))
            devices[name] = (device, (await stack.enter_async_context(emulator)).address)
        file = cells.write(folder, devices, cells.free_endpoint())
        daemon = await stack.enter_async_context(processes.daemon(file, folder))
        await asyncio.sleep(seconds)
        daemon.send_signal(signal.SIGTERM)
        await daemon.wait()


def main(out: Path) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        asyncio.run(record(folder))
        with threadpool_limits(1):
            made = train_demo(folder, demo_robot(folder / "robot"), out)
    print(f"{out}: {made.training.rows} frames, window of {made.window}, {out.stat().st_size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
