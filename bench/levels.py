"""Curves of the page out of a record of 24 h: time of a query by span, beside reading the frames of that span.

    python bench/levels.py --json

The record has 60 channels at 50 Hz in files of 10 min. In the last hour a chunk is 50 ms long and holds 500 raw samples
a second as well, as the daemon writes it; before, a chunk is 1 s of frames. A query asks for 8 channels in 1200 points.
Cold is the first query of a new process's memory (the disk's cache is warm), warm the best of five after that.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt import Batch, Channel, FrameChannel, Frames, Layout, Stream
from cellwatt.outlets.page.levels import Curves
from cellwatt.outlets.page.levels.store import ends_at
from cellwatt.record import Header, Recording
from cellwatt.record.encoder import Encoder
from cellwatt.record.header import FileName
from cellwatt.record.openfile import OpenFile

S = 10**9
SESSION = 1_795_255_200 * S
NAMES = tuple(f"arm.value_{i}" for i in range(60))
LAYOUT = Layout(tuple(FrameChannel(name, "1", "continuous", "linear") for name in NAMES), 50.0)
STREAM = Stream("rtde", tuple(Channel(f"value_{i}", "1") for i in range(60)), 500.0, "device")
SPANS = {"10 s": 10, "10 min": 600, "1 h": 3600, "24 h": 86400}


def write(folder: Path, number: int, raw: bool) -> None:
    """A file of 10 min."""
    file = OpenFile(folder / str(FileName(SESSION, number, "cell")), Header("bench", "cell", SESSION, number=number))
    encoder, random = Encoder(file), np.random.default_rng(number)
    values = np.cumsum(random.standard_normal((30_000, 60)), axis=0)
    begin = SESSION + (number - 1) * 600 * S
    size = 2 if raw else 50
    zeros = np.zeros((size, 60))
    for first in range(0, 30_000 - size + 1, size):
        at = begin + np.arange(first, first + size) * 20_000_000
        block = values[first : first + size]
        if raw:
            several = begin + np.arange(first * 10, (first + size) * 10) * 2_000_000
            known = (np.zeros(len(several), np.int64), np.repeat(block, 10, axis=0), np.zeros(len(several), np.uint8))
            encoder.add(Batch("arm", STREAM, first * 10, int(several[-1]), several, *known, several))
        encoder.add(Frames(LAYOUT, first, at, block, zeros.astype(np.uint8), zeros.astype(np.int64)))
        file.write_chunk()
    file.finish()
    file.publish()


def timed(work: Callable[[], Any]) -> float:
    """s."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def measure(folder: Path) -> dict[str, Any]:
    """Times in ms by span, and what the level files take."""
    store = Curves(folder, "cell").store
    making = timed(lambda: [store.made(kept, math.inf, ends_at(math.inf)) for kept in store.recordings()])
    files = sorted(folder.glob("*.mcap"))
    size = sum(path.stat().st_size for path in (folder / "levels").iterdir())
    found: dict[str, Any] = {"levels": {"made_s": round(making, 1), "MB": round(size / 1e6, 1), "files": len(files)}}
    found["record_MB"] = round(sum(path.stat().st_size for path in files) / 1e6)
    end = (SESSION + 86_400 * S) / 1e6
    for name, span in SPANS.items():
        curves = Curves(folder, "cell")

        def query(curves: Curves = curves, span: int = span) -> dict[str, Any]:
            return curves.curves(NAMES[:8], end - span * 1e3, end, 1200)

        row = {"cold_ms": timed(query) * 1e3, "warm_ms": min(timed(query) for _ in range(5)) * 1e3}
        answer = query()
        row |= {"points": len(answer["t"]), "step_s": answer["step_ms"] / 1e3, "json_kB": len(json.dumps(answer)) / 1e3}
        found[name] = {key: round(value, 2) for key, value in row.items()}
    found["peak_MB"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)
    for name, span in [*SPANS.items()][:-1]:  # 24 h of frames do not fit the memory
        found[name]["frames_table_ms"] = round(timed(partial(_frames, folder, span)) * 1e3, 1)
    return found


def _frames(folder: Path, span: int) -> Frames:
    recording = Recording.open(folder)
    return recording.within(86_400 - span, 86_400).frames_table()


def main() -> None:
    """Write the record, ask, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--folder", type=Path, help="of a record that an earlier run has written, or a new one")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        folder.mkdir(exist_ok=True)
        for number in range(1, 145):
            if not (folder / str(FileName(SESSION, number, "cell"))).exists():
                write(folder, number, raw=number > 138)
        found = measure(folder)
    print(json.dumps(found, indent=None if arguments.json else 1))


if __name__ == "__main__":
    main()
