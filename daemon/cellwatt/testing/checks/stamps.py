"""A driver's readings have the shapes and times that the clock model and the recording need."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cellwatt.batch import Reading
from cellwatt.channel import Quality
from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.rig import Rig, require
from cellwatt.testing.running import running

_SPAN = 1_000_000_000
"""Time, ns, over which the device's clock is compared with the cell's."""
_UNIT = 10.0
"""Largest ratio of the two: far below a wrong unit, far above the delays of a busy machine."""


async def stamps_are_right(rig: Rig, folder: Path) -> None:
    """Require correct shapes and types, arrivals between request and now, and rising device times, in ns."""
    async with EmulatedDevice(rig, folder) as device, running(rig, device.address) as source:
        began = source.inlet.now()
        await source.samples(2, "after the start")
        start = source.inlet.now()
        await source.until(lambda: source.inlet.now() - start > _SPAN, "a second")
        now = source.inlet.now()
    inlet = source.inlet
    for reading in inlet.readings:
        reading_is_whole(reading, source.driver.streams)
        require(
            began <= reading.arrival,
            f"{reading.stream.name}: arrival {reading.arrival} lies before the driver was started: use inlet.now()",
        )
    late = [r for r in inlet.readings if r.arrival > now + _SPAN]
    require(not late, f"{len(late)} readings with an arrival in the future: use inlet.now()")
    times_are_right(inlet)
    for stream in source.driver.streams:
        if stream.clock == "device":
            _device_counts_nanoseconds(stream.name, inlet.of(stream.name))


def reading_is_whole(reading: Reading, streams: Sequence[object]) -> None:
    """Require correct types and shapes of one reading."""
    name, n = reading.stream.name, len(reading.values)
    require(reading.stream in streams, f"a reading of stream {name!r}, which streams does not declare")
    shape, wanted = reading.values.shape, (n, len(reading.stream.channels))
    require(n > 0 and shape == wanted, f"{name}: values have the shape {shape}, expected (n, channels) = {wanted}")
    require(reading.values.dtype == np.float64, f"{name}: values are {reading.values.dtype}, expected float64")
    quality = reading.quality
    if quality is not None:
        good = quality.shape == (n,) and quality.dtype == np.uint8 and int(quality.max()) <= max(Quality)
        require(good, f"{name}: quality must be uint8 (n,) of cellwatt.Quality, found {quality!r}")
    if reading.stream.clock == "host":
        require(reading.device_time is None, f"{name}: device_time on a stream with clock='host'")
        return
    times = reading.device_time
    require(times is not None, f"{name}: clock='device' but device_time is None")
    assert times is not None
    good = times.shape == (n,) and times.dtype == np.int64
    require(good, f"{name}: device_time must be int64 (n,), ns; found {times.dtype} {times.shape}")


def times_are_right(inlet: CollectingInlet) -> None:
    """Require arrivals that do not step back, ``asked`` before them, and device time that rises between resets."""
    arrivals: dict[str, int] = {}
    devices: dict[tuple[str, int], int] = {}
    for reading, epoch in zip(inlet.readings, inlet.epochs, strict=True):
        name = reading.stream.name
        before = arrivals.get(name, reading.arrival)
        require(reading.arrival >= before, f"{name}: arrival steps back by {before - reading.arrival} ns")
        arrivals[name] = reading.arrival
        if reading.asked is not None:
            require(
                reading.asked <= reading.arrival,
                f"{name}: asked ({reading.asked}) is after arrival ({reading.arrival})",
            )
        if reading.device_time is not None:
            last = devices.get((name, epoch))
            steps = np.diff(reading.device_time, prepend=[] if last is None else [last])
            require(
                (steps > 0).all(),
                f"{name}: device_time does not rise (step of {steps.min(initial=1)} ns); call inlet.clock_reset() "
                "where the device's clock really changed",
            )
            devices[name, epoch] = int(reading.device_time[-1])


def _device_counts_nanoseconds(name: str, readings: Sequence[Reading]) -> None:
    require(len(readings) > 1, f"{name}: fewer than two readings in a second")
    first, last = readings[0], readings[-1]
    assert first.device_time is not None and last.device_time is not None
    device = int(last.device_time[-1]) - int(first.device_time[-1])
    cell = last.arrival - first.arrival
    require(
        cell / _UNIT < device < cell * _UNIT,
        f"{name}: in {cell / 1e9:.3f} s of the cell, device_time advanced by {device / 1e9:.6g} s: is it in ns?",
    )
