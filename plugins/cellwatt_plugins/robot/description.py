"""``robot.yaml``: what is known of a robot beside its URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationError, model_validator

from cellwatt.errors import ConfigError
from cellwatt.yaml_file import read_yaml

NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Tolerances(BaseModel):
    """How far the stated parameters may be off, as a share of their value (one standard deviation)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    friction: PositiveFloat = 0.06
    rotor_inertia: PositiveFloat = 0.03
    link: PositiveFloat = 0.03
    supply: PositiveFloat = 0.05
    unexplained: NonNegative = 0.03
    """Share of what a channel measures (standard deviation) below which nothing unexplained is told as a finding."""
    torque_gain: NonNegative | None = None
    """Common factor of all measured torques; where absent 0.1 for torque from current, 0 for measured torque."""


class Joint(BaseModel):
    """One joint; torques, inertias and friction at the joint side. 0 means that the simulation leaves the term out."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    name: str
    gear_ratio: PositiveFloat = 1.0
    torque_constant: NonNegative = 0.0
    """Nm/A at the joint side."""
    rotor_inertia: NonNegative = 0.0
    """kg m² at the joint side."""
    coulomb_friction: NonNegative = 0.0
    """Nm."""
    viscous_friction: NonNegative = 0.0
    """Nm s/rad."""
    winding_resistance: NonNegative = 0.0
    """Ω."""
    rated_torque: NonNegative = 0.0
    """Nm for 100 %."""
    lower_limit: float | None = None
    """rad; the URDF's where absent."""
    upper_limit: float | None = None
    velocity_limit: PositiveFloat | None = None
    """rad/s."""


class RobotDescription(BaseModel):
    """A robot as its user knows it."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    robot: str
    urdf: Path
    """The URDF, beside the file unless absolute."""
    joints: Annotated[tuple[Joint, ...], Field(min_length=1)]
    sample_rate: PositiveFloat | None = None
    """Hz of its recordings; found in the recording where absent."""
    standby_power: NonNegative = 0.0
    """W."""
    converter_efficiency: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the supply's power that reaches the drives."""
    regeneration: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Share of braking power that comes back to the supply."""
    tolerances: Tolerances = Tolerances()

    @model_validator(mode="after")
    def _names_differ(self) -> RobotDescription:
        names = [joint.name for joint in self.joints]
        if len(set(names)) < len(names):
            raise ValueError("two joints have the same name")
        return self


def load_robot(path: Path) -> RobotDescription:
    """Read ``robot.yaml`` (or the folder that holds it). Raises ``ConfigError`` naming the file and the key."""
    file = path / "robot.yaml" if path.is_dir() else path
    try:
        content = read_yaml(file)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{file}: cannot be read: {str(error).splitlines()[0]}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{file}: expected the keys robot, urdf and joints")
    try:
        robot = RobotDescription.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"{file}: {place}: {first['msg']} (found {repr(first['input'])[:60]})") from error
    return robot.model_copy(update={"urdf": (file.parent / robot.urdf)})
