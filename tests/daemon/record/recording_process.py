"""Records at a given rate in real time; says each number before handing it over, and how late it was woken at most.

python -m tests.daemon.record.recording_process FOLDER RATE
"""

import asyncio
import sys
import time
from pathlib import Path

import numpy as np

from cellwatt import Batch, Channel, Stream
from cellwatt.record import Header, Recorder, RecordSettings
from tests.patience import Machine

STREAM = Stream("rtde", tuple(Channel(f"joint_{i}.position", "rad") for i in range(60)), 500.0, "device")


async def main(folder: Path, rate: float, machine: Machine) -> None:
    session = time.time_ns()
    recorder = Recorder(RecordSettings(folder=folder), Header("plant-1", "weld-3", session, streams={"arm": (STREAM,)}))
    recorder.start()
    begin, random = time.monotonic(), np.random.default_rng(1)
    number = 0
    while True:
        due = int((time.monotonic() - begin) * rate)
        while number < due:
            # The number is the value, so that a wrong sample would show.
            values = random.standard_normal((1, 60))
            values[0, 0] = number
            stamp = np.array([session + int(number * 1e9 / rate)])
            quality = np.zeros(1, np.uint8)
            sys.stdout.write(f"{number} {machine.late:.3f}\n")
            sys.stdout.flush()
            recorder.put(
                Batch("arm", STREAM, number, int(stamp[0]), stamp, np.zeros(1, np.int64), values, quality, stamp)
            )
            number += 1
        await asyncio.sleep(0.5 / rate)


with Machine(Path(sys.argv[1]).parent) as machine:
    asyncio.run(main(Path(sys.argv[1]), float(sys.argv[2]), machine))
