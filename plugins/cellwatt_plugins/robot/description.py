"""``robot.yaml``: knowledge of a robot beside its URDF. Every key that any plugin reads is declared here."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationInfo, field_validator

from cellwatt.config import KeyPath, read_settings
from cellwatt.config.wording import unknown_key
from cellwatt.errors import ConfigError
from cellwatt.files import Place
from cellwatt_plugins.robot.units import Kind, unit_at

log = logging.getLogger(__name__)

PACKAGED: Final = Path(__file__).with_name("packaged")
"""Folder of the robots that come with cellwatt, one folder each."""
FORMER: Final = {"sample_rate"}
"""Keys of earlier versions, which nothing uses."""

NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Point = tuple[float, float, float]


class _Keys(BaseModel):
    model_config = ConfigDict(frozen=True, extra="allow", populate_by_name=True, use_attribute_docstrings=True)


class Tolerances(_Keys, extra="forbid"):
    """Standard deviations of the stated numbers, as a share of their value."""

    friction: PositiveFloat = 0.06
    """Tolerance of Coulomb and viscous friction."""
    rotor_inertia: PositiveFloat = 0.03
    """Tolerance of the rotors' inertia."""
    link: PositiveFloat = 0.03
    """Tolerance of mass, centre of mass and inertia of each link of the URDF."""
    supply: PositiveFloat = 0.05
    """Tolerance of standby power and winding resistances."""
    unexplained: NonNegative = 0.03
    """Smallest unexplained residual that is reported as a finding, as a share of the channel's standard deviation."""
    torque_gain: NonNegative | None = None
    """Tolerance of a factor common to all measured torques; if absent, 0.1 for torque from current, else 0."""


class Joint(_Keys):
    """One joint; torques, inertias and friction at the joint side. 0 means that the simulation leaves the term out.

    Of a prismatic joint, read m for rad, N for Nm and kg for kg m².
    """

    name: str
    """Name of the joint in the URDF; joints are listed from the base."""
    kind: Kind = "revolute"
    """``revolute`` or ``prismatic``, as in the URDF."""
    gear_ratio: PositiveFloat = 1.0
    """Turns of the motor per turn of the joint."""
    torque_constant: NonNegative = 0.0
    """Nm/A at the joint side."""
    rotor_inertia: NonNegative = 0.0
    """kg m² at the joint side."""
    coulomb_friction: NonNegative = 0.0
    """Nm at the joint side."""
    viscous_friction: NonNegative = 0.0
    """Nm s/rad at the joint side."""
    winding_resistance: NonNegative = 0.0
    """Ω."""
    rated_torque: NonNegative = 0.0
    """Nm at the joint side for 100 %."""
    lower_limit: float | None = None
    """rad; the URDF's where absent, except in ``train static``."""
    upper_limit: float | None = None
    """rad; the URDF's where absent, except in ``train static``."""
    velocity_limit: PositiveFloat | None = None
    """rad/s; the URDF's where absent."""


class Capsule(_Keys, extra="forbid"):
    """Rod with round ends on a link."""

    link: Annotated[int, Field(ge=0)]
    """Number of the link: 0 is the base, 1 the link that joint 1 moves."""
    start: Annotated[Point, Field(alias="from")]
    """x, y, z of one end in m, in the frame of the link's joint."""
    end: Annotated[Point, Field(alias="to")]
    """x, y, z of the other end in m, in the same frame."""
    radius: PositiveFloat
    """m."""


class RobotDescription(_Keys):
    """A robot as its user describes it, beside its URDF."""

    robot: str
    """Name of the robot."""
    urdf: Path
    """The URDF or a MuJoCo file; a relative path starts at this file's folder."""
    joints: Annotated[tuple[Joint, ...], Field(min_length=1)]
    """The joints that move, listed from the base."""
    gravity: Point = (0.0, 0.0, -9.81)
    """Gravity in m/s² in the base's frame; it does not point down if the arm is on a wall, a ceiling or sideways."""
    friction_lead: NonNegative = 0.0
    """Time in s by which Coulomb friction reverses before the velocity does, as MuJoCo's soft friction may."""
    standby_power: NonNegative = 0.0
    """Supply power in W while no joint moves."""
    converter_efficiency: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the supply's power that reaches the drives."""
    regeneration: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Share of the braking power that returns to the supply."""
    tolerances: Tolerances = Tolerances()
    """Tolerances of these numbers (one standard deviation each, as a share)."""
    payload: NonNegative = 0.0
    """Maximum payload in kg."""
    brakes: bool = True
    """False if the arm has no holding brakes."""
    controller_separate: bool = True
    """False if the arm cannot be unplugged from its controller, so that only their total power is measured."""
    torque_from: Literal["current", "sensor"] = "sensor"
    """Origin of the measured torques: those estimated from motor current may be wrong by a factor for each joint."""
    floor: float | None = None
    """Height of the floor above the base's origin, against gravity, m; if absent, the plane z = 0 of the base."""
    capsules: tuple[Capsule, ...] = ()
    """Outline of the arm, checked against itself and the floor; if absent, rods of 8 cm radius along the links."""

    @field_validator("joints")
    @classmethod
    def _names_differ(cls, joints: tuple[Joint, ...]) -> tuple[Joint, ...]:
        if len({joint.name for joint in joints}) < len(joints):
            raise ValueError("two joints have the same name")
        return joints

    @field_validator("capsules")
    @classmethod
    def _links_exist(cls, capsules: tuple[Capsule, ...], info: ValidationInfo) -> tuple[Capsule, ...]:
        last = len(info.data.get("joints", ()))
        if last and any(capsule.link > last for capsule in capsules):
            raise ValueError(f"a link above {last}, the last")
        return capsules

    def unit(self, joint: int, unit: str) -> str:
        """Unit at a ``joint`` (0-based) of a quantity in ``unit`` at a revolute joint: ``N`` for ``Nm`` at a prismatic
        one."""
        return unit_at(self.joints[joint].kind, unit)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each joint in the URDF."""
        return tuple(joint.name for joint in self.joints)

    @property
    def limits(self) -> NDArray[np.float64]:
        """Lowest and highest position (n, 2) rad of each joint; NaN where only the URDF states it."""
        return np.column_stack([self.column("lower_limit"), self.column("upper_limit")])

    def column(self, name: str) -> NDArray[np.float64]:
        """One number of every joint, e.g. ``coulomb_friction``: (n,), in the unit of that key; NaN where absent."""
        return np.array([getattr(joint, name) for joint in self.joints], np.float64)


def packaged() -> list[str]:
    """Names of the packaged robots."""
    return sorted(folder.name for folder in PACKAGED.iterdir() if folder.is_dir())


def robot_file(robot: Place) -> Path:
    """The ``robot.yaml`` that ``robot`` names: the file, the folder that holds it, or a packaged robot's name.

    Raises ``ConfigError`` if the name is none of these; the message suggests the nearest name.
    """
    path = Path(robot)
    if path.is_dir():
        return path / "robot.yaml"
    if path.exists() or not isinstance(robot, str) or len(path.parts) > 1 or path.suffix:
        return path
    names = packaged()
    if robot in names:
        return PACKAGED / robot / "robot.yaml"
    near = get_close_matches(robot.lower(), names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}?" if near else f"these are packaged: {', '.join(names)}"
    raise ConfigError(f"robot {robot!r}: no such file or folder, and no packaged robot of that name; {hint}")


def load_robot(robot: Place, needs: Sequence[str] = ()) -> RobotDescription:
    """Read the description of a robot: see ``robot_file``.

    ``needs`` are keys that every joint must have above 0. Raises ``ConfigError`` with file, line and column.
    """

    def problems(description: RobotDescription) -> Iterator[tuple[KeyPath, str]]:
        for i, joint in enumerate(description.joints):
            low, high = joint.lower_limit, joint.upper_limit
            if low is not None and high is not None and not low < high:
                yield ("joints", i, "lower_limit"), f"found {low:g}, expected less than upper_limit, {high:g}"
            for key in needs:
                if not getattr(joint, key) > 0:
                    yield ("joints", i, key), f"{joint.name} has no {key}: add it from the motor's data sheet"

    file = robot_file(robot)
    description = read_settings(file, RobotDescription, problems)
    for section, where in ((description, ""), *((joint, f"{joint.name}: ") for joint in description.joints)):
        for key in (section.model_extra or {}).keys() - FORMER:
            log.warning("%s: %s%s: it is not used", file, where, unknown_key(key, list(type(section).model_fields)))
    return description.model_copy(update={"urdf": (file.parent / description.urdf)})
