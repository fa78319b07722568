"""Columns of a published format and their channels with units: a YAML file that a user can override."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from cellwatt.channel import UNITS
from cellwatt.config import read_settings
from cellwatt.errors import ConfigError

FOLDER = files("cellwatt.imports") / "maps"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class Column(_Strict):
    """One channel, or with ``{}`` in both names one of each joint, counted from 1."""

    column: str
    """As the publisher calls it; in MATLAB files the path within one motion, with dots."""
    unit: str
    """Of cellwatt."""
    factor: float = 1.0
    """Values times this are in ``unit``."""
    times: str | None = None
    """Another column that the value is multiplied by: voltage times current is power."""
    optional: bool = False

    @model_validator(mode="after")
    def _known(self) -> Column:
        if self.unit not in UNITS:
            raise ValueError(f"unit {self.unit!r} is not one of {', '.join(sorted(UNITS))}")
        return self


class Source(_Strict):
    """Columns that share a clock."""

    time: str
    """Column of the time."""
    seconds: float = Field(1.0, gt=0)
    """Time times this is in s."""
    channels: Mapping[str, Column] = Field(min_length=1)


class ColumnMap(_Strict):
    """A format; ``unverified`` says what of it the publisher's documentation does not tell."""

    title: str
    licence: str
    documented: str
    """Page on which the publisher documents the columns."""
    unverified: str = ""
    layout: Literal["table", "matlab"] = "table"
    part: str | None = None
    """Column of a table that numbers the repetitions; a pattern like ``motions/motion_*/path_*`` in a MATLAB file."""
    joints: int = Field(6, ge=1, le=16)
    sources: Mapping[str, Source] = Field(min_length=1)


def shipped_maps() -> tuple[str, ...]:
    """Names of the formats that come with cellwatt."""
    return tuple(sorted(entry.name.removesuffix(".yaml") for entry in FOLDER.iterdir() if entry.name.endswith(".yaml")))


def read_map(name: str) -> ColumnMap:
    """A shipped map by name, or one of the user's by its file. Raises ``ConfigError``."""
    path = Path(name)
    if name in shipped_maps():
        path = Path(str(FOLDER / f"{name}.yaml"))
    elif path.suffix not in {".yaml", ".yml"}:
        raise ConfigError(f"no format is called {name!r}: take {', '.join(shipped_maps())}, or a YAML file of your own")
    return read_settings(path, ColumnMap)
