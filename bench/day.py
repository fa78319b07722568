"""Whether a day makes the daemon's memory grow, in some minutes: its samples pass as fast as they are recorded.

    python bench/day.py --hours 24

A UR at 500 Hz, a power board at 123 Hz and an analyzer at 10 Hz, cut into tasks, predicted by a model, recorded,
published and shown on a page that nobody looks at. All processes are the daemon's own but for the one that reads
devices: here it gives a second of samples in a block, as soon as those of half a minute before are in the record. Each
process's own memory is told at the end of each hour of the day, MB, and its slope over the last half of the day.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import tempfile
import time
from collections import defaultdict, deque
from functools import partial
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

import numpy as np
from footprint import cell, family, free_port, own, with_page
from memory import slope

from cellwatt.batch import Batch
from cellwatt.config import load
from cellwatt.emulation.arm import ArmSignals
from cellwatt.record import Recording
from cellwatt.ring import ItemWriter, Mark, Status
from cellwatt.runtime.assemble import declared
from cellwatt.runtime.processes import shared, supervisor, tell

HELD = 300.0
"""s of the day that rings hold …"""
AHEAD = 30
"""… and that may be given and not yet recorded."""
LOOKS = 20.0
"""Hz, in time that really passes, of looks at what is recorded."""


def settings(folder: Path) -> Path:
    """The file of the cell: nobody opens its devices."""
    sources = "  arm: {driver: ur, host: 127.0.0.1}\n  meter: {driver: scpi_analyzer, host: 127.0.0.1}\n"
    sources += "  board: {driver: power_board, port: /dev/null}\n"
    return cell(folder, sources, with_page(f"127.0.0.1:{free_port()}"), keep="2 GB")


def give(assignment: shared.Assignment, hours: float, passed: Synchronized[float]) -> None:
    """In place of ``collect``: the samples of ``hours`` up to now, in order; ``passed``: how many hours were given."""
    raw, out, arm = assignment.shared.raw, ItemWriter(assignment.shared.raw), ArmSignals()
    streams = [(source, stream) for source, its in declared(assignment.config)[0].items() for stream in its]
    begin, rates = time.time_ns() - round(3600e9 * hours), [max(round(stream.rate or 1.0), 1) for _, stream in streams]
    out.put(Mark(assignment.generation))
    assignment.control.send(shared.Ready())
    ends = deque([raw.head], maxlen=AHEAD)
    for second in range(round(3600 * hours)):
        for (source, stream), rate in zip(streams, rates, strict=True):
            t = second + np.arange(rate) / rate
            known, time_ns = arm.at(t), begin + (1e9 * t).astype(np.int64)
            values = np.column_stack([known.get(channel.name, np.zeros(rate)) for channel in stream.channels])
            bound, quality = np.full(rate, 100_000, np.int64), np.zeros(rate, np.uint8)
            arrival = int(time_ns[-1])
            out.put(Batch(source, stream, second * rate, arrival, time_ns, bound, values, quality, time_ns))
        out.put(Status(shared.figures("collect", assignment)))
        passed.value = (second + 1) / 3600
        while raw.position(shared.TELL) < ends[0] and not assignment.control.poll():
            time.sleep(0.5 / LOOKS)
        ends.append(raw.head)
    assignment.control.poll(None)
    out.end()


def watch(hours: float) -> dict[str, Any]:
    """MB of each process by hour of the day, its slope, and what the daemon says that it lost."""
    context = multiprocessing.get_context("fork")
    passed: Synchronized[float] = context.Value("d", 0.0)
    shared.HELD, tell.HEALTH_RATE = HELD, LOOKS  # type: ignore[misc]
    vars(supervisor)["collect"] = partial(give, hours=hours, passed=passed)
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        daemon = context.Process(target=supervisor.Supervisor(load(settings(Path(folder)))).run)
        daemon.start()
        assert daemon.pid is not None
        for hour in range(1, int(hours) + 1):
            while passed.value < hour - 1e-6 and daemon.is_alive():
                time.sleep(0.5)
            for part in family(daemon.pid):
                found[f"process {part.pid - daemon.pid}"].append((3600.0 * hour, own(part)))
        last = list(Recording.open(Path(folder) / "record").health())[-1].status
        daemon.terminate()
        daemon.join(60)
    slopes = {part: slope(np.array(seen), 1800 * hours) for part, seen in found.items() if len(seen) == int(hours)}
    told = {part: slopes[part] | {"mb": [round(size, 1) for _, size in found[part]]} for part in slopes}
    return told | {"drops": last["recorder"]["drops"], "processes": last["processes"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    print(json.dumps(watch(parser.parse_args().hours)))


if __name__ == "__main__":
    main()
