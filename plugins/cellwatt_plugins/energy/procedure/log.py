"""``campaign.json``: times of all measurements, so that they can be cut from the recording, on any day."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from cellwatt.config import read_settings
from cellwatt.errors import RecordingError, why

StateName = Literal["controller", "connected", "released"]
STATES: Final[tuple[StateName, ...]] = ("controller", "connected", "released")


class Span(BaseModel):
    """A stretch of the cell's time."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    start: int
    """UTC ns."""
    end: int


class AtRest(Span):
    """One reading of step 1; its values are told to the operator, and made anew from the recording."""

    power: float
    """W."""
    uncertainty: float
    """W, one standard deviation of the mean."""
    drift: float
    """W over the reading, by a straight line."""


class Programme(Span):
    """While one program ran, at all its speeds."""

    payload: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    """kg."""


class Log(BaseModel):
    """A campaign so far."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: str
    states: dict[StateName, AtRest] = {}
    programmes: tuple[Programme, ...] = ()

    def with_state(self, name: StateName, reading: AtRest) -> Log:
        """With a reading, instead of an earlier one of that state."""
        return self.model_copy(update={"states": {**self.states, name: reading}})

    def with_programme(self, programme: Programme) -> Log:
        """With a program's span, instead of an earlier one with that payload."""
        others = tuple(p for p in self.programmes if p.payload != programme.payload)
        return self.model_copy(update={"programmes": (*others, programme)})


def read_log(path: Path) -> Log:
    """Read ``campaign.json``. Raises ``RecordingError`` with file, line and column."""
    return read_settings(path, Log, refusal=RecordingError, computed=True)


def write_log(log: Log, path: Path) -> None:
    """Write it so that a crash leaves the old or the new one. Raises ``RecordingError``."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(log.model_dump_json(indent=1) + "\n")
        partial.replace(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {why(error)}") from error
