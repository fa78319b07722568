"""A cell's settings once they are read and right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from cellwatt.config.places import KeyPath
from cellwatt.door.signing import unusable
from cellwatt.driver import SourceSettings
from cellwatt.gather import FRAME, GATHER, LATE, UNAWAITED
from cellwatt.host import without
from cellwatt.outlet import OutletSettings
from cellwatt.quantity import Hertz, Seconds
from cellwatt.record.settings import RecordSettings
from cellwatt.stage import StageSettings
from cellwatt.units import Units

VERSION = 1
"""Form of a settings file."""

Latency = Literal["normal", "low"]
KeyPart = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]
"""A name that is one part of a Zenoh key."""


class CellName(BaseModel):
    """Name of the cell, and the robot in it."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    site: KeyPart
    """Name of the plant, first part of every Zenoh key: letters, digits, ``_``, ``-``, ``.``."""
    cell: KeyPart
    """Name of the cell within the site, second part of every Zenoh key."""
    version: int = Field(default=VERSION, ge=VERSION)
    """Version of the form of this file; one that states none is read as this."""
    robot: str | None = None
    """Robot in the cell: its name, which must be that of models and references; or a path to its ``robot.yaml`` or
    the folder that holds it."""
    latency: Latency = "normal"
    """``normal``: samples travel in blocks of 10 ms (at most half a frame) and reach a subscriber within 25 ms.
    Where nobody subscribes to them, the blocks are longer. ``low``: each goes on as it comes, for several times the
    processor time."""


class FrameSettings(BaseModel):
    """The time grid onto which all channels of the cell are brought."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    rate: Hertz = Field(default=50.0, le=1000.0)
    """Frames a second, at most 1000 Hz."""
    latency: Seconds = Field(default=0.1, validate_default=True)
    """Time that a frame waits for late samples; at least one grid step."""

    @field_validator("latency")
    @classmethod
    def _latency(cls, latency: float, info: ValidationInfo) -> float:
        rate = info.data.get("rate")
        if rate is not None and latency < (1 - 1e-9) / rate:
            raise ValueError(f"the latency must be at least one step of the frames ({1e3 / rate:g} ms at {rate:g} Hz)")
        return latency


@dataclass(frozen=True, slots=True)
class SourceConfig:
    """One source; ``place`` is ``file:line:column`` of its name."""

    name: str
    driver: str
    settings: SourceSettings
    place: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class StageConfig:
    """One stage; ``place`` is ``file:line:column`` of its name."""

    name: str
    kind: str
    settings: StageSettings
    place: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class OutletConfig:
    """One outlet that is on."""

    name: str
    settings: OutletSettings


@dataclass(frozen=True, slots=True)
class CellConfig:
    """A whole settings file.

    ``text`` is the file as written, ``${ENV}`` not filled in and secrets hidden. ``environment`` holds, by key path,
    the text to show in place of a secret or of a value that came from the environment, and ``secrets`` the values
    behind them.
    """

    path: Path
    text: str = field(repr=False)
    site: str
    cell: str
    robot: str | None
    sources: dict[str, SourceConfig]
    frames: FrameSettings
    stages: dict[str, StageConfig]
    record: RecordSettings | None
    outlets: dict[str, OutletConfig]
    units: Units = field(default_factory=Units)
    environment: Mapping[KeyPath, str] = field(default_factory=dict, repr=False)
    secrets: Mapping[str, str] = field(default_factory=dict, repr=False)
    record_place: str = field(default="", compare=False)
    """``file:line:column`` of the record folder."""
    latency: Latency = "normal"

    def gather(self, *, awaited: bool) -> float:
        """s for which samples gather before they go on, while somebody awaits them or nobody does; 0: not at all."""
        if self.latency == "low":
            return 0.0
        shortest = min(GATHER, FRAME / self.frames.rate)
        return shortest if awaited else max(shortest, min(UNAWAITED, LATE * self.frames.latency))

    @property
    def folder(self) -> Path:
        """Folder that relative paths in the settings start from."""
        return self.path.absolute().parent

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about settings that are allowed, a line each."""
        told = {name: outlet.settings.warnings() for name, outlet in self.outlets.items()}
        if self.record is not None:
            told["record"] = unusable(self.record.sign)
        found = [f"{name}: {text}" for name, texts in told.items() for text in texts]
        return tuple(without(text, self.secrets) for text in found)
