"""What disaggregation knows of an arm beside its description: payload, brakes, and where its torque comes from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cellwatt.errors import ConfigError
from cellwatt.yaml_file import read_yaml
from cellwatt_plugins.robot import RigidBody, RobotDescription, load_robot

Float = NDArray[np.float64]


class Supplied(BaseModel):
    """Keys of ``robot.yaml`` that matter for energy alone."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    payload: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Mass of the maximum payload, kg."""
    brakes: bool = True
    """False where the arm has no holding brakes."""
    controller_separate: bool = True
    """False where the arm cannot be unplugged from its controller, so that only their sum is measured."""
    torque_from: Literal["current", "sensor"] = "sensor"
    """Torque estimated from motor current may be off by a factor a joint."""


class Arm:
    """An arm as its user knows it: description, rigid body and supply."""

    def __init__(self, description: RobotDescription, supplied: Supplied) -> None:
        self.description = description
        self.supplied = supplied
        self.body = RigidBody(description.urdf, tuple(joint.name for joint in description.joints))

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.description.joints)

    def column(self, name: str) -> Float:
        """One number of every joint, e.g. ``winding_resistance``: (n,)."""
        return np.array([getattr(joint, name) for joint in self.description.joints], np.float64)


def load_arm(path: Path) -> Arm:
    """Read ``robot.yaml`` (or its folder).

    Raises ``ConfigError`` naming the file and the key, also where a torque constant or resistance is missing: without
    them nothing can be said of electrical losses.
    """
    description = load_robot(path)
    file = path / "robot.yaml" if path.is_dir() else path
    try:
        supplied = Supplied.model_validate(read_yaml(file))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"{file}: {place}: {first['msg']} (found {repr(first['input'])[:60]})") from error
    for joint in description.joints:
        for key in ("torque_constant", "winding_resistance"):
            if not getattr(joint, key) > 0:
                raise ConfigError(f"{file}: {joint.name} has no {key}: add it from the motor's data sheet")
    return Arm(description, supplied)
