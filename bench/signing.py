"""What signatures cost: processor time a message to sign and to verify, and for a finished recording.

python bench/signing.py [--json] [--repeats 7]

Messages as they are published: one sample of 60 channels, blocks of them, an alarm. Processor time of this thread, the
median of the repeats; then the share of a core at the demo's rate and at 4000 messages a second. Recording: SHA-256 of
a file of 256 MB, the size at which a file is closed.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cellwatt import Alarm, Batch, Channel, Stream
from cellwatt.outlets.zenoh.encode import encode_batch
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import encode_item
from cellwatt.outlets.zenoh.signing import Check, Seal
from cellwatt.record import seal
from cellwatt.signing import Signer, new_key

ROOT = "cellwatt/bench/cell"
EPOCH = 1_800_000_000_000_000_000
CHANNELS = 60
RATES = {"demo": 785.0, "8 arms at 500 Hz": 4000.0}
"""Messages a second: the demo's 500 + 123 + 102 + 10 + 50 (arm, board, positioner, analyzer, frames), and the load of
``bench/publish.py``."""
FILE = 256_000_000
CALLS = 200


def block(samples: int) -> bytes:
    stream = Stream("samples", tuple(Channel(f"joint_1.position_{i}", "rad") for i in range(CHANNELS)), 500.0, "device")
    time_ns = EPOCH + np.arange(samples) * 2_000_000
    values = np.random.default_rng(1).normal(size=(samples, CHANNELS))
    bound, quality = np.full(samples, 1000), np.zeros(samples, np.uint8)
    return encode_batch(Batch("arm", stream, 0, EPOCH, time_ns, bound, values, quality, time_ns))


def alarm() -> bytes:
    text = "Joint 3 needs more power than it should."
    return encode_item(Alarm("a", "joint_fault", "error", True, EPOCH, EPOCH, text), Mark(EPOCH, 0, 1, EPOCH))


def cost(work: Callable[[], object], repeats: int, calls: int = CALLS) -> float:
    """Processor time of one call, s."""
    found = []
    for _ in range(repeats):
        start = time.thread_time()
        for _ in range(calls):
            work()
        found.append((time.thread_time() - start) / calls)
    return statistics.median(found)


def measure(repeats: int) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        private, public = new_key()
        (folder / "key").write_bytes(private)
        (folder / "pub").write_bytes(public)
        signing, check = Seal(ROOT, folder / "key"), Check(ROOT, folder / "pub")
        signing.open()
        payloads = {f"samples: {n}": block(n) for n in (1, 10, 100, 1000)} | {"alarm": alarm()}
        for what, payload in payloads.items():
            mark = Mark(EPOCH, 0, 1, EPOCH).encode(payload)
            signed = signing.message("raw/arm/samples", mark, payload)
            assert check.message("raw/arm/samples", signed, payload)
            found[what] = {
                "bytes": len(payload),
                "sign_us": 1e6 * cost(lambda m=mark, p=payload: signing.message("raw/arm/samples", m, p), repeats),
                "verify_us": 1e6 * cost(lambda s=signed, p=payload: check.message("raw/arm/samples", s, p), repeats),
            }
        recording = folder / "cell_20270101T000000_000000000Z_000001.mcap"
        recording.write_bytes(bytes(FILE))
        signer = Signer(folder / "key")
        seconds = cost(lambda: seal.write(recording, "closed", signer), min(repeats, 3), 1)
        found["recording"] = {"bytes": FILE, "sign_us": 1e6 * seconds}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--repeats", type=int, default=7)
    arguments = parser.parse_args()
    found = measure(arguments.repeats)
    if arguments.json:
        print(json.dumps(found))
        return
    for what, figures in found.items():
        line = f"{what:14} {figures['bytes']:>11,.0f} bytes  sign {figures['sign_us']:9,.0f} µs"
        if "verify_us" in figures:
            line += f"  verify {figures['verify_us']:6,.0f} µs"
        print(line)
    single = found["samples: 1"]
    for name, rate in RATES.items():
        shares = [f"{side} {100e-6 * rate * single[f'{side}_us']:.1f} % of a core" for side in ("sign", "verify")]
        print(f"{name}, {rate:.0f} messages a second: {', '.join(shares)}")


if __name__ == "__main__":
    main()
