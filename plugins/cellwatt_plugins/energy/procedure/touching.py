"""Whether an arm in a pose touches itself or the floor, by Pinocchio's collision library; links are rods."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import numpy as np
import pinocchio as pin
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationError

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import RigidBody

Float = NDArray[np.float64]
Point = tuple[float, float, float]

CLEARANCE: Final = 0.02
"""m that must be left between two links, and above the floor."""
RADIUS: Final = 0.06
"""m, of links without a description."""
SHORT: Final = 0.03
"""m: a joint so close to the next is taken with it."""


class Rod(BaseModel):
    """A rod of a ``radius`` m with round ends, ``start`` to ``end`` m in the frame of a link; link 0 is the base."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    link: Annotated[int, Field(ge=0)]
    start: Annotated[Point, Field(alias="from")]
    end: Annotated[Point, Field(alias="to")]
    radius: PositiveFloat


class Shape(BaseModel):
    """``capsules`` of ``robot.yaml``, and the height m of the ``floor`` in the base's frame."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    floor: float = 0.0
    capsules: tuple[Rod, ...] = ()


def read_shape(path: Path, body: RigidBody) -> Shape:
    """Keys ``floor`` and ``capsules`` of ``robot.yaml``; without them a rod of 6 cm from each joint to the next.

    Raises ``ConfigError``.
    """
    file = path / "robot.yaml" if path.is_dir() else path
    try:
        shape = Shape.model_validate(yaml.safe_load(file.read_text()))
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"{file}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    if any(rod.link > body.joints for rod in shape.capsules):
        raise ConfigError(f"{file}: capsules: a link above {body.joints}, the last")
    return shape if shape.capsules else shape.model_copy(update={"capsules": _rods(body)})


class Clearance:
    """How far the links of an arm are from each other and from the floor.

    Rods of the same or neighbouring links are left out, and pairs that are too close where all joints are at 0.
    """

    def __init__(self, body: RigidBody, shape: Shape) -> None:
        self._body, self._shape = body, shape
        self._data = body.model.createData()
        self._rods = [_capsule(rod) for rod in shape.capsules]
        rods = shape.capsules
        apart = [(i, j) for i in range(len(rods)) for j in range(i) if abs(rods[i].link - rods[j].link) > 1]
        places = self._places(np.zeros(body.joints))
        self._pairs = [pair for pair in apart if self._gap(places, *pair) > 0]

    def gaps(self, q: Float) -> Float:
        """Clearance (k,) m of each pair and of each rod above the floor, at ``q`` (n,) rad."""
        places = self._places(q)
        pairs = [self._gap(places, i, j) for i, j in self._pairs]
        return np.array([*pairs, *self._heights()])

    def free(self, q: Float) -> bool:
        """Whether all of them are ``CLEARANCE`` or more."""
        return bool(np.all(self.gaps(q) >= CLEARANCE))

    def _places(self, q: Float) -> list[object]:
        pin.forwardKinematics(self._body.model, self._data, q)
        return [
            self._place(rod.link, offset) for rod, (_, offset) in zip(self._shape.capsules, self._rods, strict=True)
        ]

    def _place(self, link: int, offset: pin.SE3) -> object:
        frame = self._data.oMi[link] * offset
        return pin.coal.Transform3s(frame.rotation, frame.translation)

    def _gap(self, places: list[object], i: int, j: int) -> float:
        found = pin.coal.DistanceResult()
        request = pin.coal.DistanceRequest()
        return float(pin.coal.distance(self._rods[i][0], places[i], self._rods[j][0], places[j], request, found))

    def _heights(self) -> list[float]:
        # The base and what turns on it stand on the floor.
        return [
            min(float(self._data.oMi[rod.link].act(np.array(end))[2]) for end in (rod.start, rod.end))
            - rod.radius
            - self._shape.floor
            for rod in self._shape.capsules
            if rod.link > 1
        ]


def _capsule(rod: Rod) -> tuple[object, pin.SE3]:
    """Coal's capsule lies along its own z axis about its middle."""
    start, end = np.array(rod.start), np.array(rod.end)
    along = end - start
    length = float(np.linalg.norm(along))
    turn = (
        pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along / length)
        if length
        else pin.Quaternion.Identity()
    )
    return pin.coal.Capsule(rod.radius, max(length, 1e-6)), pin.SE3(turn.matrix(), (start + end) / 2)


def _rods(body: RigidBody) -> tuple[Rod, ...]:
    tips = [body.model.jointPlacements[i + 1].translation for i in range(body.joints)]
    return tuple(
        Rod(link=i, start=(0.0, 0.0, 0.0), end=(float(tip[0]), float(tip[1]), float(tip[2])), radius=RADIUS)
        for i, tip in enumerate(tips)
        if np.linalg.norm(tip) > SHORT
    )
