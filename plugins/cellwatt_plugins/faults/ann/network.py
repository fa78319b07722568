"""The trained network in a file, and what it says of a cycle."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.ann.bins import Bins, inputs_of
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.network_file import MOTION, Ends, Opened

Float = NDArray[np.float64]

VERSION = 1
ENDS = Ends("motion", "faults")


@dataclass(frozen=True)
class PatternHead:
    """Head of the network's file: its task, the order of its inputs and outputs, the probability from
    which a fault of power is reported (``limit``), and how it was made."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    version: Literal[1]
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

    def __init__(self, network: Opened) -> None:
        self._network = network
        self.where = network.where
        try:
            self.head = TypeAdapter(PatternHead).validate_python(network.metadata(MOTION))
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise ModelError(f"{self.where}: its metadata is wrong: {place}: {first['msg']}") from error
        sizes = ([len(self.head.inputs)], [len(self.head.outputs)])
        if network.sizes() != sizes or len(self.head.outputs) != 2 * self.head.joints + 1:
            raise ModelError(
                f"{self.where}: its graph has {network.sizes()[0]} inputs and {network.sizes()[1]} outputs, expected "
                f"{sizes[0]} and {sizes[1]} as in its metadata, for {self.head.joints} joints"
            )

    def differs(self, pattern: Pattern) -> str:
        """Name what differs between a healthy cycle and the training; empty if nothing does."""
        names = Bins(pattern).names
        if len(names) != len(self.head.inputs):
            return f"{len(names)} inputs, expected {len(self.head.inputs)}"
        return "" if digest(pattern) == self.head.reference else "another healthy cycle than it was trained against"

    def probabilities(self, inputs: Float) -> Float:
        """(N, 2 n + 1) for inputs (N, inputs)."""
        return self._network.run(ENDS, inputs)

    def tell(self, recording: Recording, match: Match, pattern: Pattern) -> Told:
        """Judge one cycle."""
        bins, n = Bins(pattern), self.head.joints
        inputs = inputs_of(recording, match, bins)
        found = self.probabilities(inputs[None])[0]
        rests = inputs[-(bins.moves + 1) * n :].reshape(bins.moves + 1, n)
        return Told(found[:n], found[n : 2 * n], float(found[-1]), inputs[: bins.power], np.abs(rests).max(axis=0))
