"""``robot.yaml``: knowledge of a robot beside its URDF. Every key that any plugin reads is declared here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    ValidationInfo,
    field_validator,
)

from cellwatt.config import KeyPath, read_settings
from cellwatt.errors import ConfigError
from cellwatt.files import Place
from cellwatt_plugins.robot.units import Kind, unit_at

PACKAGED: Final = Path(__file__).with_name("packaged")
"""Folder of the robots that come with cellwatt, one folder each."""

NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Point = tuple[float, float, float]


class _Keys(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", populate_by_name=True, use_attribute_docstrings=True)


class Tolerances(_Keys, extra="forbid"):
    """Standard deviations of the stated numbers, as a share of their value."""

    friction: PositiveFloat = 0.06
    """Of Coulomb and viscous friction."""
    rotor_inertia: PositiveFloat = 0.03
    """Of the rotors' inertia."""
    link: PositiveFloat = 0.03
    """Of mass, centre of mass and inertia of each link of the URDF."""
    supply: PositiveFloat = 0.05
    """Of standby power and winding resistances."""
    unexplained: NonNegative = 0.03
    """Share of what a channel measures (standard deviation) below which nothing unexplained is told as a finding."""
    torque_gain: NonNegative | None = None
    """Of all measured torques together; where absent 0.1 for torque from current, 0 for measured torque."""


class Joint(_Keys):
    """One joint; torques, inertias and friction at the joint side. 0 means that the simulation leaves the term out.

    Of a prismatic joint, read m for rad, N for Nm and kg for kg m².
    """

    name: str
    """Name of the joint in the URDF; joints come in the order from the base."""
    kind: Kind = "revolute"
    """``revolute`` or ``prismatic``: the URDF's."""
    gear_ratio: PositiveFloat = 1.0
    """Turns of the motor for one of the joint."""
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
    """rad; the URDF's where absent."""
    upper_limit: float | None = None
    """rad; the URDF's where absent."""
    velocity_limit: PositiveFloat | None = None
    """rad/s; the URDF's where absent."""


class Capsule(_Keys, extra="forbid"):
    """Rod with round ends on a link."""

    link: Annotated[int, Field(ge=0)]
    """1 is what joint 1 moves, 0 the base."""
    start: Annotated[Point, Field(alias="from")]
    """x, y, z of one end, m in the link's frame (that of its joint)."""
    end: Annotated[Point, Field(alias="to")]
    """x, y, z of the other end."""
    radius: PositiveFloat
    """m."""


class RobotDescription(_Keys):
    """A robot as its user knows it; a URDF is beside it."""

    robot: str
    """Name of the robot."""
    urdf: Path
    """The URDF, or a MuJoCo file, beside this file unless absolute."""
    joints: Annotated[tuple[Joint, ...], Field(min_length=1)]
    """The joints that move, from the base."""
    gravity: Point = (0.0, 0.0, -9.81)
    """m/s² in the base's frame: of an arm on a wall or a ceiling, or mounted sideways, it does not point down."""
    friction_lead: NonNegative = 0.0
    """s by which Coulomb friction turns over before the velocity does: MuJoCo's soft friction may do so."""
    standby_power: NonNegative = 0.0
    """W at the supply while nothing moves."""
    converter_efficiency: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the supply's power that reaches the drives."""
    regeneration: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Share of braking power that comes back to the supply."""
    tolerances: Tolerances = Tolerances()
    """Shares by which these numbers may be off (one standard deviation)."""
    payload: NonNegative = 0.0
    """kg of the maximum payload."""
    brakes: bool = True
    """False where the arm has no holding brakes."""
    controller_separate: bool = True
    """False where the arm cannot be unplugged from its controller, so that only their sum is measured."""
    torque_from: Literal["current", "sensor"] = "sensor"
    """Origin of the robot's torques: an estimate from motor current may be off by a factor a joint."""
    floor: float = 0.0
    """Height of the floor in the base's frame, m."""
    capsules: tuple[Capsule, ...] = ()
    """Outline of the arm, which must touch neither itself nor the floor; rods of 8 cm along the links where absent."""

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
        """Unit at a ``joint`` (0-based) of what has ``unit`` at a revolute one: ``N`` for ``Nm`` at a prismatic one."""
        return unit_at(self.joints[joint].kind, unit)

    @property
    def limits(self) -> NDArray[np.float64]:
        """Lowest and highest position (n, 2) rad of each joint; NaN where it is left to the URDF."""
        return np.column_stack([self.column("lower_limit"), self.column("upper_limit")])

    def column(self, name: str) -> NDArray[np.float64]:
        """One number of every joint, e.g. ``coulomb_friction``: (n,), in the unit of that key; NaN where absent."""
        return np.array([getattr(joint, name) for joint in self.joints], np.float64)


def packaged() -> list[str]:
    """Names of the packaged robots."""
    return sorted(folder.name for folder in PACKAGED.iterdir() if folder.is_dir())


def robot_file(robot: Place) -> Path:
    """The ``robot.yaml`` that ``robot`` names: the file, the folder that holds it, or a packaged robot's name.

    Raises ``ConfigError`` where a name is neither; it says the nearest one.
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

    def lacking(description: RobotDescription) -> Iterator[tuple[KeyPath, str]]:
        for i, joint in enumerate(description.joints):
            for key in needs:
                if not getattr(joint, key) > 0:
                    yield ("joints", i, key), f"{joint.name} has no {key}: add it from the motor's data sheet"

    file = robot_file(robot)
    description = read_settings(file, RobotDescription, lacking)
    return description.model_copy(update={"urdf": (file.parent / description.urdf)})
