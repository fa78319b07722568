"""How fast the power board's frames are decoded, next to the packet parser of Digi's library, in one run.

    python bench/power_board.py [--json] [--frames 40000] [--rounds 7]

Ours is given the raw stream in reads of 4 KiB and does everything up to checked integers: framing, API checksum,
CRC, fields. Digi's ``build_frame`` is given each frame already cut out and, for AP=2, already unescaped; it checks
the API checksum and gives the payload as bytes. Rounds of all contenders alternate; the figures are frames a second
of processor time, the median, lowest and highest of the rounds.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import sys
import time
from collections.abc import Callable

from cellwatt_drivers.power_board import payload, wire

READ = 4096
SENDER, NETWORK = 0x0013A20040401122, 0x1A2B


def stream(frames: int, samples: int, mode: wire.Mode) -> list[bytes]:
    """Frames of a three-phase board, each with other values."""
    step = 8130 if samples > 1 else 0
    made = []
    for number in range(frames):
        raw = tuple((number * 7919 + i * 104729) % 60000 for i in range(9 * samples))
        packet = payload.Packet(7, number * samples % 2**16, number * 8130 * samples % 2**32, step, 3, raw)
        made.append(wire.wrap(payload.build(packet), mode, sender=SENDER, network=NETWORK))
    return made


def ours(frames: list[bytes], mode: wire.Mode) -> Callable[[], int]:
    """Decode the whole stream; gives the packets found."""
    data = b"".join(frames)
    reads = [data[i : i + READ] for i in range(0, len(data), READ)]

    def run() -> int:
        decoder = wire.decoder(mode)
        return sum(len(decoder.feed(read)) for read in reads)

    return run


def digi(frames: list[bytes]) -> Callable[[], int]:
    """Parse each frame with Digi's library; gives the packets with data."""
    from digi.xbee.models.mode import OperatingMode
    from digi.xbee.packets.factory import build_frame

    cut = [bytearray(f) for f in frames]

    def run() -> int:
        return sum(bool(build_frame(f, OperatingMode.API_MODE).rf_data) for f in cut)

    return run


def measure(contenders: dict[str, Callable[[], int]], frames: int, rounds: int) -> dict[str, dict[str, float]]:
    """Frames a second of processor time of each, over alternating rounds."""
    rates: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, run in contenders.items():
            start = time.process_time()
            found = run()
            rates[name].append(found / (time.process_time() - start))
            if found != frames:
                sys.exit(f"{name}: {found} of {frames} frames found")
    return {
        name: {"median": round(statistics.median(r)), "lowest": round(min(r)), "highest": round(max(r))}
        for name, r in rates.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--frames", type=int, default=40_000)
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    contenders: dict[str, Callable[[], int]] = {}
    for mode in wire.MODES:
        for samples in (1, 2):
            contenders[f"{mode}, {samples} per packet"] = ours(stream(given.frames, samples, mode), mode)
    contenders["digi-xbee build_frame (AP=1)"] = digi(stream(given.frames, 1, "api"))
    rates = measure(contenders, given.frames, given.rounds)
    if given.json:
        about = {"python": platform.python_version(), "frames": given.frames, "rounds": given.rounds}
        print(json.dumps({"power_board_frames_per_second": rates, "about": about}))
        return
    for name, rate in rates.items():
        print(f"{name:32} {rate['median']:>9,} frames/s  ({rate['lowest']:,} – {rate['highest']:,})")


if __name__ == "__main__":
    main()
