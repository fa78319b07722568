"""``cellwatt train plan-poses``: plan, table and job of one robot."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.config import load
from cellwatt.errors import ConfigError
from cellwatt.files import write_csv, write_file
from cellwatt_plugins.models.static.plan import Plan, plan_poses
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.collision import Checker

LONGEST: Final = 900
"""Largest number of poses in one job: controllers accept 999 steps."""
_LARGEST: Final = 2**31 - 1


def pulses_of(q: Float, encoders: Any) -> NDArray[np.int64]:
    """Pulses of joint angles ``q`` (N, n) rad, by ``encoders``, the settings of a yaskawa source.

    Joint angles are coupling · motor angles + zero. Raises ``ConfigError`` if the settings have another number of
    joints.
    """
    n, per_degree = q.shape[1], np.array(encoders.pulses_per_degree, np.float64)
    if len(per_degree) != n:
        raise ConfigError(f"pulses_per_degree has {len(per_degree)} values, the robot {n} joints")
    zero, coupling = getattr(encoders, "zero", None), getattr(encoders, "coupling", None)
    motors = q - (0.0 if zero is None else np.array(zero))
    if coupling is not None:
        motors = motors @ np.linalg.inv(np.array(coupling)).T
    pulses = np.rint(np.degrees(motors) * per_degree)
    if np.abs(pulses).max() > _LARGEST:
        raise ConfigError("pulses_per_degree: a pose exceeds the largest number of pulses of a controller")
    return pulses.astype(np.int64)


def jobs(name: str, q: Float, encoders: Any, speed: float, hold: float, when: datetime) -> dict[str, str]:
    """File name → text of the jobs that visit ``q`` (N, n) rad and wait ``hold`` s in each.

    ``speed`` is a percentage of the joints' full speed.
    """
    pulses = pulses_of(q, encoders)
    parts = np.array_split(pulses, -(-len(pulses) // LONGEST))
    names = [name] if len(parts) == 1 else [f"{name}-{i + 1}" for i in range(len(parts))]
    return {f"{n}.JBI": _job(n, part, speed, hold, when) for n, part in zip(names, parts, strict=True)}


def _job(name: str, pulses: NDArray[np.int64], speed: float, hold: float, when: datetime) -> str:
    head = [
        "/JOB",
        f"//NAME {name}",
        "//POS",
        f"///NPOS {len(pulses)},0,0,0,0,0",
        "///TOOL 0",
        "///POSTYPE PULSE",
        "///PULSE",
    ]
    points = [f"C{i:05d}={','.join(map(str, row))}" for i, row in enumerate(pulses.tolist())]
    middle = ["//INST", f"///DATE {when:%Y/%m/%d %H:%M}", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    moves = [line for i in range(len(pulses)) for line in (f"MOVJ C{i:05d} VJ={speed:.2f} PL=0", f"TIMER T={hold:.2f}")]
    return "\r\n".join([*head, *points, *middle, *moves, "END", ""])


PAPERS: Final = "mh12"
"""The robot of the paper, packaged with the limits of its Table II."""
UNSTATED: Final = 1.0
"""Assumed velocity in rad/s of a joint without a velocity limit."""
_RAMP: Final = 0.4  # s that acceleration and deceleration add to a move at full speed


@dataclass(frozen=True)
class PlanReport:
    """Plan and the files that it was written to."""

    robot: str
    plan: Plan
    duration: float
    """Duration in s, with the pauses."""
    files: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the report as ``--json`` prints it."""
        plan = self.plan
        return {
            "robot": self.robot,
            "poses": len(plan.q),
            "unsafe": plan.unsafe,
            "unreachable": plan.unreachable,
            "travel_s": plan.travel,
            "unordered_s": plan.unordered,
            "rising": plan.rising.tolist(),
            "duration_s": self.duration,
            "files": self.files,
        }

    def in_words(self) -> str:
        """Return the report as text."""
        plan = self.plan
        even = ", ".join(f"{100 * share:.0f} %" for share in plan.rising)
        lines = [
            f"{len(plan.q)} poses of {self.robot}; {plan.unsafe} positions were left out because the arm would touch "
            f"itself or the floor, and {plan.unreachable} poses because the straight path to them is not safe",
            f"moves take {plan.travel:.0f} s in all at full speed, {plan.unordered:.0f} s before ordering",
            f"joint angles rise in {even} of the moves",
            f"about {self.duration / 60:.0f} min with the pauses",
            f"written: {', '.join(self.files)}",
        ]
        if not any(file.endswith(".JBI") for file in self.files):
            lines.append("no job: it needs --cell with a yaskawa source that has pulses_per_degree")
        return "\n".join(lines)


def write_plan(
    robot: Path | None,
    count: int,
    out: Path,
    cell: Path | None,
    source: str | None,
    speed: float,
    hold: float,
    name: str,
) -> PlanReport:
    """Plans, and writes plan.csv and the job. Raises ``ConfigError`` and ``CellwattError``."""
    arm = Arm.load(PAPERS if robot is None else robot, weighed=False)
    limits = arm.finite_limits()
    fastest = np.where(arm.velocity_limits > 0, arm.velocity_limits, UNSTATED)
    plan = plan_poses(count, limits, fastest, Checker(arm, limits))
    rows = [[i, *(f"{angle:.6f}" for angle in row)] for i, row in enumerate(plan.q.tolist())]
    write_csv(out / "plan.csv", [["pose", *(f"q_{i + 1}" for i in range(plan.q.shape[1]))], *rows])
    texts: dict[str, str] = {}
    if cell is not None:
        texts = jobs(name, plan.q, _encoders(cell, source), speed, hold, datetime.now())
    for file, text in texts.items():
        write_file(out / file, text)
    duration = plan.travel / (speed / 100) + len(plan.q) * (hold + _RAMP)
    files = tuple(str(out / file) for file in ("plan.csv", *texts))
    return PlanReport(arm.name, plan, duration, files)


def _encoders(cell: Path, source: str | None) -> Any:
    """The settings of the one source that has ``pulses_per_degree``."""
    sources = load(cell).sources
    if source is not None and source not in sources:
        raise ConfigError(f"{cell}: no source {source!r}, there are: {', '.join(sources)}")
    wanted = sources if source is None else {source: sources[source]}
    counted = {n: s.settings for n, s in wanted.items() if getattr(s.settings, "pulses_per_degree", ())}
    if len(counted) != 1:
        found = f"these have: {', '.join(counted)}: choose one with --source" if counted else "none has"
        raise ConfigError(f"{cell}: expected one source with pulses_per_degree; {found}")
    (settings,) = counted.values()
    return settings
