"""A subscriber that counts frames: ``python -m outlet.zenoh_reader ENDPOINT KEY``; each order begins a new count."""

from __future__ import annotations

import sys
import time
from array import array
from typing import Any

import numpy as np

from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from outlet.children import orders, say


def main(endpoint: str, key: str) -> None:
    """Say how late frames were since the last order, and how many numbers are missing."""
    delays, numbers = array("q"), array("q")

    def take(sample: Any) -> None:
        mark = sample.attachment.to_bytes()
        delays.append(time.time_ns() - int.from_bytes(mark[24:32], "little"))
        numbers.append(int.from_bytes(mark[16:24], "little"))

    with open_session(LinkSettings(mode="client", connect=(endpoint,)), patience=60.0) as session:
        session.declare_subscriber(key, take)
        say("ready")
        for _ in orders():
            late, seen = np.array(delays) / 1e6, np.array(numbers)
            del delays[:], numbers[:]
            if not len(seen):
                say({})
                continue
            lost = int(seen.max() - seen.min() + 1 - len(np.unique(seen)))
            say({"lost": lost, "p50_ms": float(np.percentile(late, 50)), "p99_ms": float(np.percentile(late, 99))})


if __name__ == "__main__":
    main(*sys.argv[1:])
