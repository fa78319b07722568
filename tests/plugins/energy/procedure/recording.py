"""What the plant's arms do, as a recording of cellwatt and as a feed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cellwatt import Batch, Channel, Stream
from cellwatt.record import Header, Recording
from tests.daemon.record.making import write_chunks

SESSION = 1_795_000_000_000_000_000
BLOCK = 5000
SUPPLY = Stream("measured", (Channel("supply.voltage", "V"), Channel("supply.power", "W")), 10.0, "host")


def arm_stream(joints, by_current, rate):
    third = ("current", "A") if by_current else ("torque", "Nm")
    kinds = (("position", "rad"), ("velocity", "rad/s"), third)
    channels = tuple(Channel(f"joint_{i}.{name}", unit) for name, unit in kinds for i in range(1, joints + 1))
    return Stream("arm", channels, rate, "device")


class Taped:
    """Puts spans one after the other into a recording, on the cell's time."""

    def __init__(self, folder: Path, arm, seed=1):
        self.folder, self.arm, self.now = folder, arm, SESSION
        self.rng = np.random.default_rng(seed)
        self.states, self.programmes = {}, {}
        self.stream = arm_stream(arm.made.joints, arm.made.by_current, 500.0)
        self._arm, self._supply = [], []

    def state(self, name, power, seconds=60.0):
        """A reading at rest; the arm says nothing."""
        end = self.now + round(seconds * 1e9)
        self._power(np.full(round(seconds * 500), power))
        self.states[name] = self.now, end
        self.now = end + 30_000_000_000

    def programme(self, payload, rows, watts):
        """One program: rows (N, 3 n) and power (N,) at 500 Hz."""
        time = self.now + np.arange(len(rows)) * 2_000_000
        values = rows.copy()
        if self.arm.made.by_current:
            values[:, 2 * self.arm.made.joints :] /= self.arm.constant
        self._arm.append((time, values))
        self._power(watts)
        end = int(time[-1])
        self.programmes[payload] = self.now, end
        self.now = end + 30_000_000_000

    def _power(self, watts):
        """Means over 0.1 s with noise of 0.08 W, each stamped 0.1 s after the middle of its time."""
        means = watts[: len(watts) // 50 * 50].reshape(-1, 50).mean(axis=1)
        time = self.now + 150_000_000 + np.arange(len(means)) * 100_000_000
        noisy = means + self.rng.normal(0, 0.08, len(means))
        self._supply.append((time, np.column_stack([np.full(len(means), 230.0), noisy])))

    def without(self, source, start, end):
        """Forgets a source's samples between two times, s after the last program's start."""
        kept = self._arm if source == "arm" else self._supply
        time, values = kept[-1]
        begun = list(self.programmes.values())[-1][0]
        gone = (time > begun + start * 1e9) & (time < begun + end * 1e9)
        kept[-1] = (time[~gone], values[~gone])

    def write(self):
        """The recording."""
        header = Header("plant", "cell", SESSION, streams={"arm": (self.stream,), "supply": (SUPPLY,)})
        blocks = [*_blocks("arm", self.stream, self._arm), *_blocks("supply", SUPPLY, self._supply)]
        write_chunks(self.folder, ([b] for b in sorted(blocks, key=lambda b: int(b.time[0]))), header=header)
        return Recording.open(self.folder)


def _blocks(source, stream, parts):
    count = 0
    for time, values in parts:
        for i in range(0, len(time), BLOCK):
            t, v = time[i : i + BLOCK], values[i : i + BLOCK]
            yield Batch(source, stream, count, int(t[-1]), t, np.full(len(t), 1000), v, np.zeros(len(t), np.uint8))
            count += len(t)
