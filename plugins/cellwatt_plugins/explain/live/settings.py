"""Settings of the ``mismatch`` stage."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from cellwatt.quantity import Bytes, Fraction, Hertz, Seconds
from cellwatt.section import Section
from cellwatt_plugins.robot_name import RobotStageSettings


class BandSettings(Section):
    """Permitted difference between recording and simulation, interval by interval."""

    noise: float = Field(default=4.0, ge=1, allow_inf_nan=False)
    """The band is this multiple of the channel's noise floor, which is measured continuously …"""
    share: Fraction = Field(default=0.10, ge=0)
    """… plus this share of the simulated value (root mean square over the interval)."""
    confirm: int = Field(default=3, ge=1, le=100)
    """Number of intervals outside the band that raise a channel's alarm; as many of the same motion inside clear it."""


class ExplainSettings(Section):
    """Conditions under which ``cellwatt explain`` is started, and its limits."""

    after: int = Field(default=20, ge=1, le=10000)
    """Number of intervals in which a channel must have been outside its band."""
    every: Seconds = Field(default=3600.0, gt=0)
    """At most one explanation is started in this time."""
    recording: Seconds = Field(default=60.0, ge=10)
    """Longest recording that is explained: the data since the first interval outside, at most this much."""
    limit: Seconds = Field(default=600.0, gt=0)
    """An explanation that takes longer is stopped."""
    memory: Bytes = Field(default=8e8, gt=0)
    """An explanation that needs more memory is stopped."""
    folder: Path | None = None
    """Folder for recordings, models and reports; ``mismatch`` in the daemon's working directory if left out."""
    keep: int = Field(default=10, ge=1, le=10000)
    """Number of explanations stored in ``folder``; older ones are deleted."""


class MismatchSettings(RobotStageSettings):
    """Runs the simulation of an arm beside its recording and reports where and since when the two differ."""

    simulation: str = "robot"
    """``robot``: the law in robot.yaml; or the model.yaml written by ``cellwatt explain``, or its folder.

    Or the name of a source that streams the user's simulation as ``joint_1.torque`` … and ``supply.power``.
    """
    robot: Path | None = None
    """The robot's description, its folder, or a simulator's file; by default the cell's ``robot``, if that is a folder.

    An MJCF with position servos is enough for an arm that gives target positions, and neither torque nor current.
    """
    arm: str | None = None
    """Source with the joints; may be omitted if only one source has joints."""
    command_rate: Hertz | None = None
    """For an arm without torque: rate of the commands to its servos; by default the cell's rate.

    Each command holds until the next, so on average it acts half that time late.
    """
    power: str | None = None
    """Channel of the supply's power; by default the only ``supply.power``, or none if there is none."""
    band: BandSettings = BandSettings()
    """Permitted difference between recording and simulation, interval by interval."""
    explain: ExplainSettings | None = ExplainSettings()
    """Conditions under which the difference is explained; ``null`` disables explanations."""

    def files(self, folder: Path, robot: Path | None) -> Sequence[Path]:
        """See ``StageSettings.files``; with the model in the folder that ``simulation`` may name."""
        return [*super().files(folder, robot), folder / self.simulation / "model.yaml"]
