"""Names and units of the channels that a side is judged by."""

from __future__ import annotations

from cellwatt_plugins.mismatch.fit.problem import Problem


def channel_name(problem: Problem, index: int) -> str:
    """``tau_3`` of the third joint's torque, ``power`` of the supply."""
    return "power" if problem.side == "supply" else f"tau_{index + 1}"


def channel_unit(problem: Problem, index: int) -> str:
    """``W`` of the supply; ``N*m`` of a revolute joint, ``N`` of a prismatic one."""
    return "W" if problem.side == "supply" else problem.states[0].robot.unit(index, "N*m")
