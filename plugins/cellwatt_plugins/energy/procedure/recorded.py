"""Reads the samples of an arm and of the analyzer from a recording, with times in s from its start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt.channel import Stream
from cellwatt.errors import RecordingError
from cellwatt.record import Recording
from cellwatt_plugins.energy.drive import effort
from cellwatt_plugins.energy.recordings import FEWEST, PowerTrace, RobotTrace
from cellwatt_plugins.robot import Arm

PLACE = "the recording"


def motion_of(recording: Recording, arm: Arm, source: str | None = None) -> RobotTrace:
    """Motion of an arm; ``source`` names its source if several have joints. Raises ``RecordingError``."""
    name, stream = _stream_with(recording, "joint_1.position", source, "--source")
    quantity, unit = effort(stream.names, arm)
    kinds = ("position", "velocity", quantity)
    time, values = _samples(
        recording, name, stream, [f"joint_{i}.{kind}" for kind in kinds for i in range(1, arm.joints + 1)]
    )
    position, velocity, given = values.reshape(len(time), len(kinds), arm.joints).transpose(1, 0, 2)
    return RobotTrace(PLACE, time, position, velocity, given * unit)


def power_of(recording: Recording, supply: str | None = None) -> PowerTrace:
    """Power; ``supply`` names the analyzer's source if several have power. Raises ``RecordingError``."""
    name, stream = _stream_with(recording, "supply.power", supply, "--supply")
    time, values = _samples(recording, name, stream, ["supply.power"])
    return PowerTrace(PLACE, time, values[:, 0])


def _samples(recording: Recording, source: str, stream: Stream, names: Sequence[str]) -> tuple[Float, Float]:
    """Times (N,) s and values (N, k) of a stream, without samples that miss a value."""
    if missing := [name for name in names if name not in stream.names]:
        raise RecordingError(f"{PLACE}: {stream.name} has no {missing[0]}: add it to the source's channels and repeat")
    samples = recording.batches(source, stream.name)
    picked = samples.values[:, [stream.names.index(name) for name in names]]
    whole = np.isfinite(picked).all(axis=1)
    if (count := int(whole.sum())) < FEWEST:
        raise RecordingError(f"{PLACE}: {count} samples of {source} in it, expected {FEWEST}: was cellwatt running?")
    return np.asarray((samples.time[whole] - recording.start) * 1e-9), picked[whole]


def _stream_with(whole: Recording, channel: str, wanted: str | None, option: str) -> tuple[str, Stream]:
    found = [(source, s) for source, streams in whole.streams.items() for s in streams if channel in s.names]
    chosen = [one for one in found if wanted in (None, one[0])]
    if len(chosen) == 1:
        return chosen[0]
    there = ", ".join(source for source, _ in found) or "none"
    raise RecordingError(f"{PLACE}: expected one source with {channel}, there are: {there}; choose it with {option}")
