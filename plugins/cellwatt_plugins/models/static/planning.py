"""``cellwatt train plan-poses``: the plan of one robot, and its table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from cellwatt.files import write_csv
from cellwatt_plugins.models.static.plan import Plan, plan_poses
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.collision import Checker

PAPERS: Final = "mh12"
"""The robot of the paper, packaged with the limits of its Table II."""
UNSTATED: Final = 1.0
"""Assumed velocity in rad/s of a joint without a velocity limit."""
SPEED: Final = 0.25
"""Share of full speed at which the arm is thought to visit the poses."""
PAUSE: Final = 3.4
"""s in each pose, with acceleration and deceleration: the pose must be held for 2.5 s."""


@dataclass(frozen=True)
class PlanReport:
    """Plan and the file that it was written to."""

    robot: str
    plan: Plan
    file: str

    @property
    def duration(self) -> float:
        """Duration in s, with the pauses."""
        return self.plan.travel / SPEED + len(self.plan.q) * PAUSE

    def as_json(self) -> dict[str, Any]:
        """Return the report as ``--json`` prints it."""
        plan = self.plan
        return {
            "robot": self.robot,
            "poses": len(plan.q),
            "unsafe": plan.unsafe,
            "unreachable": plan.unreachable,
            "travel_s": plan.travel,
            "duration_s": self.duration,
            "file": self.file,
        }

    def in_words(self) -> str:
        """Return the report as text."""
        plan = self.plan
        return "\n".join(
            [
                f"{len(plan.q)} poses of {self.robot}; {plan.unsafe} positions were left out because the arm would "
                f"touch itself or the floor, and {plan.unreachable} poses because the straight path to them is not "
                "safe",
                f"moves take {plan.travel:.0f} s in all at full speed",
                f"about {self.duration / 60:.0f} min at {100 * SPEED:.0f} % of full speed, with the pauses",
                f"written: {self.file}",
            ]
        )


def write_plan(robot: Path | None, count: int, out: Path) -> PlanReport:
    """Plans, and writes plan.csv. Raises ``ConfigError`` and ``CellwattError``."""
    arm = Arm.load(PAPERS if robot is None else robot, weighed=False)
    limits = arm.finite_limits()
    fastest = np.where(arm.velocity_limits > 0, arm.velocity_limits, UNSTATED)
    plan = plan_poses(count, limits, fastest, Checker(arm, limits))
    rows = [[i, *(f"{angle:.6f}" for angle in row)] for i, row in enumerate(plan.q.tolist())]
    file = out / "plan.csv"
    write_csv(file, [["pose", *(f"q_{i + 1}" for i in range(plan.q.shape[1]))], *rows])
    return PlanReport(arm.name, plan, str(file))
