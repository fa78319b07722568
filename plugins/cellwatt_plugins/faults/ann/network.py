"""The trained network in a file, and what it says of a cycle."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from cellwatt.config import reads_version
from cellwatt.onnx_file import OnnxFile
from cellwatt_plugins.faults.ann.bins import Bins, inputs_of
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.network_file import MOTION, Ends

Float = NDArray[np.float64]

VERSION = 1
ENDS = Ends("motion", "faults")


@dataclass(frozen=True)
class PatternHead:
    """Head of the network's file: its task, the order of its inputs and outputs, the probability from
    which a fault of power is reported (``limit``), and how it was made."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    version: Annotated[int, reads_version(VERSION, "train it anew, or update cellwatt")]
    task: str
    speed: float
    reference: str
    """SHA-256 of the healthy cycle in the reference that it was trained against."""
    joints: Annotated[int, Field(ge=1)]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    limit: Annotated[float, Field(ge=0, le=1)]
    false_alarms: float
    made: Mapping[str, Any]


def digest(pattern: Pattern) -> str:
    """SHA-256 of a healthy cycle, as rounded as it stands in the reference."""
    parts = (np.round(pattern.power, 1), np.round(pattern.position, 4), np.round(np.array(pattern.moves), 3))
    return hashlib.sha256(b"".join(np.ascontiguousarray(p + 0.0, "<f8").tobytes() for p in parts)).hexdigest()


@dataclass(frozen=True)
class Told:
    """Probabilities (n,) that joints, and encoders, are faulty, and that any joint is; ``watts`` (power,) W, what power
    differs by in each part of the motion; ``off`` (n,) rad, how far encoders are off their path in rests."""

    joints: Float
    encoders: Float
    any_joint: float
    watts: Float
    off: Float


class PatternNetwork:
    """A network of residuals over a motion, run by onnxruntime.

    Raises ``ModelError`` where the file is none, or its metadata is wrong or does not agree with its graph.
    """

    def __init__(self, network: OnnxFile) -> None:
        self._network = network
        self.head = network.metadata(MOTION, PatternHead)
        columns = [tensor.shape[-1] for tensor in network.inputs], [tensor.shape[-1] for tensor in network.outputs]
        sizes = [len(self.head.inputs)], [len(self.head.outputs)]
        if columns != sizes or len(self.head.outputs) != 2 * self.head.joints + 1:
            raise network.refused(
                f"its graph has {columns[0]} inputs and {columns[1]} outputs, expected {sizes[0]} and {sizes[1]} as in "
                f"its metadata, for {self.head.joints} joints"
            )

    def differs(self, pattern: Pattern) -> str:
        """Name what differs between a healthy cycle and the training; empty if nothing does."""
        names = Bins(pattern).names
        if len(names) != len(self.head.inputs):
            return f"{len(names)} inputs, expected {len(self.head.inputs)}"
        return "" if digest(pattern) == self.head.reference else "another healthy cycle than it was trained against"

    def probabilities(self, inputs: Float) -> Float:
        """(N, 2 n + 1) for inputs (N, inputs)."""
        return self._network.run(inputs.astype(np.float32))

    def tell(self, recording: Recording, match: Match, pattern: Pattern) -> Told:
        """Judge one cycle."""
        bins, n = Bins(pattern), self.head.joints
        inputs = inputs_of(recording, match, bins)
        found = self.probabilities(inputs[None])[0]
        rests = inputs[-(bins.moves + 1) * n :].reshape(bins.moves + 1, n)
        return Told(found[:n], found[n : 2 * n], float(found[-1]), inputs[: bins.power], np.abs(rests).max(axis=0))
