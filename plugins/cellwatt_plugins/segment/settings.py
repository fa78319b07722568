"""Settings of the segmentation: the speed at which a joint counts as moving, the differences between equal moves."""

from __future__ import annotations

import math

from pydantic import Field, model_validator

from cellwatt.quantity import Fraction, Radians, RadiansPerSecond, Seconds
from cellwatt.stage import StageSettings


class SegmentSettings(StageSettings):
    """Cuts the motion of one arm into intervals and tasks, from its encoder positions alone."""

    arm: str | None = None
    """Source with the joints; not needed if only one source has joints."""
    start_speed: RadiansPerSecond = math.radians(1.0)
    """A joint starts to move above this speed; raised automatically if the encoder noise requires it."""
    stop_speed: RadiansPerSecond = math.radians(0.5)
    """A joint stops below this speed."""
    minimum_length: Seconds = Field(default=0.12, ge=0)
    """Shortest interval; a set of moving joints that lasts less is merged with its neighbours."""
    minimum_travel: Radians = Field(default=math.radians(1.0), ge=0)
    """A joint that starts before any other has moved this far belongs to the same interval from its start."""
    gap: Seconds = Field(default=0.1, gt=0)
    """Positions missing for longer than this end the interval."""
    same_displacement: Radians = Field(default=math.radians(2.0), gt=0)
    """Moves are the same up to this difference in each joint's displacement (a smaller move counts as rest) …"""
    same_pose: Radians = Field(default=math.radians(6.0), gt=0)
    """… and up to this difference in each joint's start position."""
    same_speed: Fraction = Field(default=0.03, gt=0)
    """Repetitions of a task are one variant if their moving times differ by less than this."""

    @model_validator(mode="after")
    def _hysteresis(self) -> SegmentSettings:
        if self.stop_speed > self.start_speed:
            raise ValueError("stop_speed must not be above start_speed")
        return self
