"""The validated settings of a cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from cellwatt.config.places import KeyPath
from cellwatt.driver import SourceSettings
from cellwatt.gather import FRAME, GATHER, LATE, UNAWAITED
from cellwatt.host import without
from cellwatt.outlet import OutletSettings
from cellwatt.quantity import Hertz, Seconds
from cellwatt.record.settings import RecordSettings
from cellwatt.section import Section
from cellwatt.stage import StageSettings
from cellwatt.units import Units

VERSION = 1
"""Format version of a settings file."""

Latency = Literal["normal", "low"]
KeyPart = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]
"""A name that is one element of a Zenoh key."""


class CellName(Section):
    """Name of the cell, and the robot in it."""

    site: KeyPart
    """Name of the plant, first element of every Zenoh key: letters, digits, ``.``, ``_`` and ``-``."""
    cell: KeyPart
    """Name of the cell within the site, second element of every Zenoh key: letters, digits, ``.``, ``_`` and ``-``."""
    version: int = Field(default=VERSION, ge=VERSION)
    """Format version of this file; a file without this key is read as this version."""
    robot: str | None = None
    """Robot in the cell: its name, which must match the name in models and references; or the path of its
    ``robot.yaml`` or of the folder that contains it."""
    latency: Latency = "normal"
    """How soon samples are sent: ``normal`` in blocks of 10 ms (at most half a frame), which reach a subscriber within
    25 ms; without a subscriber the blocks are longer. ``low``: each sample as soon as it arrives, which takes several
    times the processor time."""


class FrameSettings(Section):
    """The common time grid to which all channels of the cell are aligned."""

    rate: Hertz = Field(default=50.0, le=1000.0)
    """Frames per second, at most 1000 Hz."""
    latency: Seconds = Field(default=0.1, validate_default=True)
    """Time for which a frame waits for late samples; at least one grid step."""

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
    """One stage; ``place`` is ``file:line:column`` of its name.

    ``written``: modification times, ns, of the files that it reads, so that a reload applies a model learned again.
    """

    name: str
    kind: str
    settings: StageSettings
    place: str = field(default="", compare=False)
    written: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class OutletConfig:
    """One enabled outlet."""

    name: str
    settings: OutletSettings


@dataclass(frozen=True, slots=True)
class CellConfig:
    """All settings of one file.

    ``text`` is the text of the file with secrets hidden and ``${ENV}`` not expanded. ``environment`` maps the key path
    of each secret and of each value from the environment to the text shown instead; ``secrets`` maps the values
    themselves to that text.
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
        """Time, s, for which samples are collected into one block; longer if no consumer waits; 0: no collecting."""
        if self.latency == "low":
            return 0.0
        shortest = min(GATHER, FRAME / self.frames.rate)
        return shortest if awaited else max(shortest, min(UNAWAITED, LATE * self.frames.latency))

    @property
    def folder(self) -> Path:
        """Folder to which relative paths in the settings refer."""
        return self.path.absolute().parent

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about valid but dangerous settings, one line each."""
        found = [f"{name}: {text}" for name, outlet in self.outlets.items() for text in outlet.settings.warnings()]
        return tuple(without(text, self.secrets) for text in found)
