"""The robot's programs of a campaign as text, for the operator to load and run: cellwatt itself moves nothing."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.energy.procedure.cube import Cube

Float = NDArray[np.float64]

DWELL: Final = 1.0
"""s of rest at S before and after each repetition: by them repetitions are recognised."""
BETWEEN: Final = 5.0
"""s of rest before each speed."""
APPROACH: Final = 0.05
"""m/s of the way to S."""
POINTS: Final = ("S", "P1", "P2", "P3", "P4", "S")

_SCRIPT = """\
# {title}
# S, P1, P2, P3, P4, S of the ISO 9283 cube in straight legs; each leg takes its length over the speed.
# Before the start: payload and its centre set in the installation, speed slider at 100 %, arm near S, way to S free.
# To try the path first, write slow: speeds = [0.02], repetitions = 1.
def {name}():
  payload = {payload:g}
  repetitions = {repetitions}
  speeds = [{speeds}]
  points = [{points}]
  legs = [{legs}]
  if norm(get_target_payload() - payload) > 0.1:
    popup("The payload is not {payload:g} kg: set it in the installation.", "cellwatt", error=True, blocking=True)
    halt
  end
  popup("The arm now moves straight to S at {approach:g} mm/s.", "cellwatt", blocking=True)
  movel(points[4], a=0.1, v={approach_m:g})
  i = 0
  while i < {speed_count}:
    textmsg("cellwatt: mm/s ", 1000 * speeds[i])
    sleep({between:g})
    n = 0
    while n < repetitions:
      sleep({dwell:g})
      k = 0
      while k < {leg_count}:
        movel(points[k], t=legs[k] / speeds[i])
        k = k + 1
      end
      n = n + 1
    end
    sleep({between:g})
    i = i + 1
  end
  popup("All runs with {payload:g} kg are done.", "cellwatt")
end
"""


def urscript(robot: str, cube: Cube, payload: float, speeds: Sequence[float], repetitions: int) -> str:
    """URScript of all ``speeds`` mm/s with one ``payload`` kg."""
    turn = ", ".join(f"{angle:.6f}" for angle in cube.orientation)
    poses = [f"p[{', '.join(f'{x:.4f}' for x in point)}, {turn}]" for point in cube.path[1:]]
    return _SCRIPT.format(
        title=f"{robot}: energy campaign, payload {payload:g} kg, {_list(speeds)} mm/s, {repetitions} repetitions",
        name=f"cellwatt_{payload:g}kg".replace(".", "_"),
        payload=payload,
        repetitions=repetitions,
        speeds=_list([speed / 1000 for speed in speeds]),
        speed_count=len(speeds),
        points=", ".join(poses),
        legs=", ".join(f"{leg:.6f}" for leg in cube.legs),
        leg_count=len(cube.legs),
        dwell=DWELL,
        between=BETWEEN,
        approach=1000 * APPROACH,
        approach_m=APPROACH,
    )


def waypoints(robot: str, cube: Cube, payload: float, speeds: Sequence[float], repetitions: int) -> str:
    """The same as JSON for any controller: poses in m and rotation vectors, and for each speed the time of each leg."""
    names = [*POINTS[:-1]]
    content: dict[str, Any] = {
        "robot": robot,
        "frame": "base",
        "units": {"position": "m", "rotation_vector": "rad", "speed": "mm/s", "time": "s", "payload": "kg"},
        "payload": payload,
        "poses": {
            name: {"position": _rounded(point), "rotation_vector": list(cube.orientation)}
            for name, point in zip(names, cube.path, strict=False)
        },
        "approach": {"to": "S", "speed": 1000 * APPROACH},
        "runs": [
            {
                "speed": speed,
                "repetitions": repetitions,
                "dwell_before_run": BETWEEN,
                "dwell_at_start_before_each_repetition": DWELL,
                "legs": [
                    {"to": to, "straight": True, "seconds": round(float(seconds), 4)}
                    for to, seconds in zip(POINTS[1:], cube.seconds(speed), strict=True)
                ],
            }
            for speed in speeds
        ],
        "dwell_after_last": BETWEEN,
    }
    return json.dumps(content, indent=1) + "\n"


def programs(robot: str, cube: Cube, speeds: Sequence[float], repetitions: int) -> dict[str, str]:
    """File name and text of each: one without and one with the maximum payload."""
    write, ending = (urscript, "script") if cube.program == "urscript" else (waypoints, "json")
    return {
        f"{robot}_{payload:g}kg.{ending}": write(robot, cube, payload, speeds, repetitions)
        for payload in (0.0, cube.payload)
    }


def minutes(cube: Cube, speeds: Sequence[float], repetitions: int) -> float:
    """Duration of one program, min."""
    moving = sum(float(cube.seconds(speed).sum()) for speed in speeds) * repetitions
    return (moving + len(speeds) * (repetitions * DWELL + 2 * BETWEEN)) / 60


def _rounded(point: Float) -> list[float]:
    return [round(float(x), 6) for x in point]


def _list(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)
