"""The path that a campaign repeats: S–P1–P2–P3–P4–S in the diagonal plane of the ISO 9283 cube (ECDP, Table I)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from cellwatt.config import read_settings
from cellwatt.errors import ConfigError

Float = NDArray[np.float64]
Vector = tuple[float, float, float]

PACKAGED: Final = Path(__file__).with_name("cubes.yaml")
SPEEDS: Final = (50.0, 100.0, 150.0, 200.0, 250.0)
"""mm/s, means over a repetition."""
REPETITIONS: Final = 30
"""ISO 9283's advice for each test."""


class Cube(BaseModel):
    """Cube that one robot moves in, in m and rad in its base frame."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    points: tuple[Vector, Vector, Vector, Vector]
    """P1 … P4."""
    payload: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Maximum payload, kg."""
    program: Literal["urscript", "waypoints"] = "waypoints"
    orientation: Vector = (0.0, 1.570796, 0.0)
    """Rotation vector of the tool, rad, the same all along."""

    @property
    def path(self) -> Float:
        """S, P1, P2, P3, P4, S: (6, 3) m. S is the middle of P4–P1, where Table III's times have it."""
        corners = np.array(self.points)
        start = (corners[3] + corners[0]) / 2
        return np.vstack([start, corners, start])

    @property
    def legs(self) -> Float:
        """Lengths (5,) m of the straight legs."""
        return np.asarray(np.linalg.norm(np.diff(self.path, axis=0), axis=1))

    def seconds(self, speed: float) -> Float:
        """Time (5,) s of each leg, so that the mean speed of a repetition is ``speed`` mm/s."""
        return self.legs * 1000.0 / speed


def load_cube(robot: str, file: Path | None = None) -> Cube:
    """The cube of a robot of Table I, or of a file of the same form. Raises ``ConfigError``."""
    path = file or PACKAGED
    cubes = read_settings(path, dict[str, Cube])
    name = next((n for n in cubes if n.lower() == robot.lower()), None)
    if name is None:
        raise ConfigError(f"no cube for robot {robot!r}, there are: {', '.join(cubes)}; give yours with --cube")
    return cubes[name]
