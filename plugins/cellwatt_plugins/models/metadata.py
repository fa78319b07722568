"""Metadata of a model file: JSON under the key ``cellwatt`` of the ONNX file's ``metadata_props``."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    TypeAdapter,
    model_validator,
)
from pydantic.dataclasses import dataclass

from cellwatt.channel import UNITS
from cellwatt.config import reads_version
from cellwatt.errors import ModelError
from cellwatt_plugins.onnx_file import OnnxFile

KEY = "cellwatt"
VERSION: Final = 1
SAME_RATE: Final = 0.02
"""Largest difference between the rate of frames or rows and that of a model's training, as a share: a training takes
the rate from the clock of its recording."""

_CONFIG = ConfigDict(extra="forbid")


def _known_unit(unit: str) -> str:
    if unit not in UNITS:
        raise ValueError(f"expected one of {', '.join(sorted(UNITS))}")
    return unit


def _rising(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError("expected [low, high] with low not above high")
    return limits


Name = Annotated[str, Field(min_length=1)]
Unit = Annotated[str, AfterValidator(_known_unit)]
Range = Annotated[tuple[FiniteFloat, FiniteFloat], AfterValidator(_rising)]


@dataclass(frozen=True, slots=True, config=_CONFIG)
class Input:
    """One input: a channel by its name within its source (``joint_1.position``), and the unit it must have.

    An ``optional`` input may be missing, in a frame or altogether; the model then gets NaN for it.
    """

    channel: Name
    unit: Unit
    optional: bool = False


@dataclass(frozen=True, slots=True, config=_CONFIG)
class Output:
    """One output: the name it is published under, and its unit."""

    name: Name
    unit: Unit


@dataclass(frozen=True, slots=True, kw_only=True, config=_CONFIG)
class Training:
    """Origin of a model.

    ``data`` is the SHA-256 of the training data, ``range`` the lowest and highest value of each input in it,
    ``created`` when the model was made (with its time zone), ``rows`` how many frames it has seen.
    """

    data: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    range: tuple[Range, ...]
    created: AwareDatetime
    rows: Annotated[int, Field(ge=1)]

    @classmethod
    def of(cls, table: ArrayLike, created: datetime | None = None) -> Training:
        """Describes a training table, (rows, inputs) in the units of the inputs; ``created`` is now when left out.

        The digest is that of the table as little-endian float64, row after row. Values that are not finite are
        left out of the ranges. Raises ``ModelError`` if the table is not two-dimensional or a column has no finite
        value.
        """
        values = np.ascontiguousarray(table, dtype="<f8")
        if values.ndim != 2 or not np.isfinite(values).any(axis=0).all():
            raise ModelError(
                f"expected a training table (rows, inputs) with numbers in each column, found shape {values.shape}"
            )
        finite = np.where(np.isfinite(values), values, np.nan)
        limits = zip(np.nanmin(finite, axis=0).tolist(), np.nanmax(finite, axis=0).tolist(), strict=True)
        digest = hashlib.sha256(values.tobytes()).hexdigest()
        return cls(data=digest, range=tuple(limits), created=created or datetime.now(UTC), rows=len(values))


@dataclass(frozen=True, slots=True, kw_only=True, config=_CONFIG)
class Metadata:
    """Identity of a model and its inputs; raises ``pydantic.ValidationError`` if they contradict each other.

    ``robot`` and ``rate_hz`` (of the frames) are ``None`` for a model that fits any. ``joints`` are the robot's joint
    names in order, for tables that name their joints. ``window`` is the number of frames, the newest last, that the
    model sees at once; its outputs are those of the frame ``delay`` frames before the newest.
    """

    version: Literal[1] = VERSION
    name: Name
    robot: Name | None
    joints: tuple[Name, ...] = ()
    inputs: Annotated[tuple[Input, ...], Field(min_length=1)]
    outputs: Annotated[tuple[Output, ...], Field(min_length=1)]
    rate_hz: Annotated[FiniteFloat, Field(gt=0)] | None
    window: Annotated[int, Field(ge=1, le=10_000)] = 1
    delay: Annotated[int, Field(ge=0)] = 0
    training: Training

    @model_validator(mode="after")
    def _consistent(self) -> Metadata:
        for what, names in (
            ("input channel", [i.channel for i in self.inputs]),
            ("output", [o.name for o in self.outputs]),
        ):
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise ValueError(f"the {what} {twice!r} is given twice")
        if self.delay >= self.window:
            raise ValueError(f"a delay of {self.delay} frames is not within a window of {self.window}")
        if len(self.training.range) != len(self.inputs):
            raise ValueError(f"training.range has {len(self.training.range)} entries for {len(self.inputs)} inputs")
        return self


_UNIT_OF = {"position": "rad", "velocity": "rad/s", "temperature": "degC", "approach": "rad"}
"""Units of the joint quantities that models take."""


def joint_inputs(joints: int, *quantities: str, optional: bool = False) -> tuple[Input, ...]:
    """``joint_1.position``, ``joint_2.position``, … for each quantity in turn."""
    return tuple(Input(f"joint_{i + 1}.{q}", _UNIT_OF[q], optional) for q in quantities for i in range(joints))


_ADAPTER: TypeAdapter[Metadata] = TypeAdapter(Metadata)


def encode(metadata: Metadata) -> str:
    """The JSON text that the file holds."""
    return _ADAPTER.dump_json(metadata).decode()


class _Stated(BaseModel):
    """The key that every version of the metadata has."""

    version: Annotated[int, reads_version(VERSION, "update cellwatt, or describe the model again")]


def metadata_of(file: OnnxFile) -> Metadata:
    """Metadata of an open file. Raises ``ModelError`` if it has none, or one of another version, or a wrong one."""
    if KEY not in file.properties:
        there = ", ".join(map(repr, file.properties)) or "none"
        raise file.refused(
            f"it has no metadata: expected the key {KEY!r}, found {there}; "
            "cellwatt_plugins.models.describe() writes it into the file"
        )
    file.entry(KEY, _Stated)
    return file.entry(KEY, Metadata)
