"""Whether an arm in a pose touches itself or the floor; links are rods with round ends."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationError

from cellwatt.errors import ConfigError
from cellwatt.yaml_file import read_yaml
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
        outline = Outline.model_validate(read_yaml(file))
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"{file}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    except (OSError, ValueError) as error:
        raise ConfigError(f"{file}: cannot be read: {str(error).splitlines()[0]}") from error
    if any(capsule.link > body.joints for capsule in outline.capsules):
        raise ConfigError(f"{file}: capsules: a link above {body.joints}, the last")
    return outline if outline.capsules else outline.model_copy(update={"capsules": _rods(body)})


class Checker:
    """Checks poses of one arm. Rods of neighbouring links are left out, and pairs that are closer than ``CLEARANCE`` in
    the middle of all ranges (``limits`` (n, 2) rad).
    """

    def __init__(self, body: RigidBody, outline: Outline, limits: Float) -> None:
        self._body = body
        self._data = body.model.createData()
        self._outline = outline
        every = outline.capsules
        self._radii = np.array([capsule.radius for capsule in every])
        # The base and what turns on it stand on the floor.
        self._above = np.array([i for i, capsule in enumerate(every) if capsule.link > 1], np.intp)
        apart = [(i, j) for i in range(len(every)) for j in range(i) if abs(every[i].link - every[j].link) > 1]
        pairs = np.array(apart, np.intp).reshape(-1, 2)
        self._pairs = pairs[self._between(self._ends(limits.mean(axis=1)[None]), pairs)[0] > CLEARANCE]

    def gaps(self, q: Float) -> Float:
        """Clearance (N, k) m of each pair, then of each rod above the floor, in poses ``q`` (N, n) rad."""
        ends = self._ends(q)
        lowest = ends[:, self._above].min(axis=2)[:, :, 2] - self._radii[self._above]
        return np.hstack([self._between(ends, self._pairs), lowest - self._outline.floor])

    def safe(self, q: Float) -> NDArray[np.bool_]:
        """Whether all of them are ``CLEARANCE`` or more, in poses (N, n) rad: (N,)."""
        return np.asarray((self.gaps(q) >= CLEARANCE).all(axis=1))

    def safe_move(self, start: Float, end: Float, step: float = 0.08) -> bool:
        """Whether the straight way between two poses (n,), all joints together, is safe; checked every ``step`` rad."""
        count = max(2, int(np.ceil(np.max(np.abs(end - start)) / step)))
        return bool(self.safe(start + np.linspace(0, 1, count + 1)[:, None] * (end - start)).all())

    def _ends(self, q: Float) -> Float:
        """Both ends of each of K capsules in the base's frame: (N, K, 2, 3)."""
        points = [np.array([capsule.start, capsule.end]) for capsule in self._outline.capsules]
        out = np.empty((len(q), len(points), 2, 3))
        for row, angles in enumerate(q):
            pin.forwardKinematics(self._body.model, self._data, angles)
            for i, (capsule, point) in enumerate(zip(self._outline.capsules, points, strict=True)):
                frame = self._data.oMi[capsule.link]
                out[row, i] = point @ frame.rotation.T + frame.translation
        return out

    def _between(self, ends: Float, pairs: NDArray[np.intp]) -> Float:
        """Gaps (N, P) of pairs (P, 2)."""
        one, other = pairs.T
        apart = distance(ends[:, one].reshape(-1, 2, 3), ends[:, other].reshape(-1, 2, 3))
        return np.asarray(apart.reshape(len(ends), len(pairs)) - self._radii[one] - self._radii[other])


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
