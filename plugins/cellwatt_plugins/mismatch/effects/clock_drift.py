"""A delay between torque and position that grows with time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cellwatt_plugins.mismatch.effects.effect import Confusion, Effect, Estimate, Float, Shape
from cellwatt_plugins.mismatch.effects.time_delay import SHARE, shifted
from cellwatt_plugins.mismatch.findings import Parameter
from cellwatt_plugins.mismatch.states import States
from cellwatt_plugins.robot.description import RobotDescription

RATES = tuple(sign * r for r in (0.0002, 0.0005, 0.001, 0.002, 0.004) for sign in (1, -1))
"""s a second."""


class ClockDrift(Effect):
    """Torque of t - rate · (t - start of the run)."""

    name = "clock_drift"
    everywhere = True
    place = "robot"
    after = True
    unit_scale = True
    confusions = (Confusion("time_delay", "record for longer: a delay stays, a drift grows"),)

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        return [(r,) for r in RATES]

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        longest = max(float(run.time[-1] - run.time[0]) for run in runs)
        return not any(run.unplanned for run in runs) or abs(shape[0]) * longest > SHARE * runs[0].step

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return (shifted(run.time, run.torque, shape[0] * (run.time - run.time[0])) - run.torque)[:, :, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(-0.02, 0.02)]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"rate": estimate.shaped(0, "s/s")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        rate = parameters["rate"]
        return (
            f"Torque and position drift apart by {1000 * rate.value:.3g} ± {1000 * rate.std:.2g} ms a second: "
            "the two clocks drift."
        )
