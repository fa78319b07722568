"""Whether an arm in a pose touches itself or the floor; links are rods with round ends."""

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
_RADIUS: Final = 0.08  # m, of links without a description


class Capsule(BaseModel):
    """A rod of a ``radius`` m with round ends, ``start`` to ``end`` m in the frame of a link; link 0 is the base."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    link: Annotated[int, Field(ge=0)]
    start: Annotated[Point, Field(alias="from")]
    end: Annotated[Point, Field(alias="to")]
    radius: PositiveFloat


class Outline(BaseModel):
    """What of a robot must not touch: ``capsules``, and the height m of the ``floor`` in the base's frame."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    floor: float = 0.0
    capsules: tuple[Capsule, ...] = ()


def read_outline(path: Path, body: RigidBody) -> Outline:
    """The keys ``floor`` and ``capsules`` of robot.yaml; without them a rod of 8 cm from each joint to the next.

    Raises ``ConfigError``.
    """
    file = path / "robot.yaml" if path.is_dir() else path
    try:
        outline = Outline.model_validate(yaml.safe_load(file.read_text()))
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"{file}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    if any(capsule.link > body.joints for capsule in outline.capsules):
        raise ConfigError(f"{file}: capsules: a link above {body.joints}, the last")
    return outline if outline.capsules else outline.model_copy(update={"capsules": _rods(body)})


class Checker:
    """Checks poses of one arm. Pairs that touch in the middle of all ranges (``limits`` (n, 2) rad) are left out."""

    def __init__(self, body: RigidBody, outline: Outline, limits: Float) -> None:
        self._body = body
        self._data = body.model.createData()
        self._outline = outline
        every = outline.capsules
        apart = [(i, j) for i in range(len(every)) for j in range(i) if abs(every[i].link - every[j].link) > 1]
        ends = self._ends(limits.mean(axis=1)[None])
        self._pairs = [pair for pair in apart if self._gap(ends, *pair)[0] > CLEARANCE]

    def safe(self, q: Float) -> NDArray[np.bool_]:
        """For poses (N, n) rad: (N,)."""
        ends = self._ends(q)
        safe = np.ones(len(q), dtype=np.bool_)
        for capsule, end in zip(self._outline.capsules, ends, strict=True):
            if capsule.link > 1:  # the base and what turns on it stand on the floor
                safe &= end[:, :, 2].min(axis=1) - capsule.radius > self._outline.floor + CLEARANCE
        for i, j in self._pairs:
            safe &= self._gap(ends, i, j) > CLEARANCE
        return safe

    def safe_move(self, start: Float, end: Float, step: float = 0.08) -> bool:
        """Whether the straight way between two poses (n,), all joints together, is safe; checked every ``step`` rad."""
        count = max(2, int(np.ceil(np.max(np.abs(end - start)) / step)))
        return bool(self.safe(start + np.linspace(0, 1, count + 1)[:, None] * (end - start)).all())

    def _ends(self, q: Float) -> list[Float]:
        """Both ends of each capsule in the base's frame: (N, 2, 3)."""
        points = [np.array([capsule.start, capsule.end]) for capsule in self._outline.capsules]
        out = [np.empty((len(q), 2, 3)) for _ in points]
        for row, angles in enumerate(q):
            pin.forwardKinematics(self._body.model, self._data, angles)
            for capsule, point, ends in zip(self._outline.capsules, points, out, strict=True):
                frame = self._data.oMi[capsule.link]
                ends[row] = point @ frame.rotation.T + frame.translation
        return out

    def _gap(self, ends: list[Float], i: int, j: int) -> Float:
        radii = self._outline.capsules[i].radius + self._outline.capsules[j].radius
        return distance(ends[i], ends[j]) - radii


def distance(a: Float, b: Float) -> Float:
    """Distance (N,) between segments ``a`` and ``b`` (N, 2, 3); Ericson, Real-Time Collision Detection, 5.1.9."""
    start, along, across = a[:, 0] - b[:, 0], a[:, 1] - a[:, 0], b[:, 1] - b[:, 0]

    def dot(x: Float, y: Float) -> Float:
        return np.asarray(np.sum(x * y, axis=1))

    tiny = 1e-12
    aa, bb, ab = dot(along, along) + tiny, dot(across, across) + tiny, dot(along, across)
    c, f = dot(along, start), dot(across, start)
    parallel = aa * bb - ab**2
    s = np.clip(np.where(parallel > tiny, (ab * f - c * bb) / np.maximum(parallel, tiny), 0.0), 0.0, 1.0)
    t = np.clip((ab * s + f) / bb, 0.0, 1.0)
    s = np.clip((t * ab - c) / aa, 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + s[:, None] * along - t[:, None] * across, axis=1))


def _rods(body: RigidBody) -> tuple[Capsule, ...]:
    tips = [body.model.jointPlacements[i + 1].translation.tolist() for i in range(body.joints)]
    return tuple(Capsule(link=i, start=(0.0, 0.0, 0.0), end=tip, radius=_RADIUS) for i, tip in enumerate(tips))
