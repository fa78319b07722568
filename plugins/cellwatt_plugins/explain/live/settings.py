"""Settings of the ``mismatch`` stage."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from cellwatt.quantity import Bytes, Fraction, Hertz, Seconds
from cellwatt.stage import StageSettings


class BandSettings(BaseModel):
    """Permitted difference between recording and simulation, interval by interval."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    noise: float = Field(default=4.0, ge=1, allow_inf_nan=False)
    """So many times the channel's noise floor, which is measured all along …"""
    share: Fraction = Field(default=0.10, ge=0)
    """… plus this share of what the simulation says, as the root mean square over the interval …"""
    learn: int = Field(default=0, ge=0, le=1000)
    """… plus the largest residual of the first so many intervals of the same motion, taken as normal; 0: none."""
    confirm: int = Field(default=3, ge=1, le=100)
    """Intervals outside that raise a channel's alarm; as many of the same motion inside clear it."""


class ExplainSettings(BaseModel):
    """Conditions under which ``cellwatt explain`` is started, and the resources that it may take."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    after: int = Field(default=20, ge=1, le=10000)
    """Intervals that a channel must have been outside its band in."""
    every: Seconds = Field(default=3600.0, gt=0)
    """At most one explanation in this time."""
    recording: Seconds = Field(default=60.0, ge=10)
    """It is given the time since the first interval outside, but no more than the last so much."""
    limit: Seconds = Field(default=600.0, gt=0)
    """It is ended when it takes longer."""
    memory: Bytes = Field(default=8e8, gt=0)
    """It is ended when it needs more."""
    folder: Path | None = None
    """Folder for recordings, models and reports; ``mismatch`` in the daemon's working directory if left out."""
    keep: int = Field(default=10, ge=1, le=10000)
    """Explanations that are kept there; older ones are deleted."""


class MismatchSettings(StageSettings):
    """Runs the simulation of an arm beside its recording and says where and since when the two differ."""

    simulation: str = "robot"
    """``robot``: the law in robot.yaml; or the model.yaml that ``cellwatt explain`` wrote, or its folder.

    Or a source that streams what the user's simulation says: its name, with ``joint_1.torque`` … and ``supply.power``.
    """
    robot: Path | None = None
    """The robot's description, its folder, or a simulator's file; the cell's ``robot`` where that is a folder.

    An MJCF with position servos is enough for an arm that gives target positions, and neither torque nor current.
    """
    arm: str | None = None
    """Source with the joints; may be left out where only one source has joints."""
    command_rate: Hertz | None = None
    """Of an arm without torque: how often its servos are told where to go, the cell's rate where left out.

    Each command holds until the next, so what they are told is half as long late.
    """
    power: str | None = None
    """Channel of the supply's power; the only ``supply.power`` where left out, none where there is none."""
    band: BandSettings = BandSettings()
    """Permitted difference between recording and simulation, interval by interval."""
    explain: ExplainSettings | None = ExplainSettings()
    """Conditions under which the difference is explained; ``null``: never."""
