"""A load that a thermostat switches on and off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.load.payload_change import inside
from cellwatt_plugins.robot.effects.load.schedule import levels, switching_charge
from cellwatt_plugins.robot.effects.states import States

SHORTEST = 2.0
"""Shortest time in s for which a thermostat runs a fan."""


class FanSwitching(Effect):
    """Constant power while a thermostat has the fan on.

    The stretches are found in the recordings. Where the first start, the time on and the time off are the same in all
    runs, that cycle is the shape (first, on, off) and predicts other runs; else (run, start, end, …) with -1 in front.
    """

    name = "fan_switching"
    acts_on = "supply"
    depends_on = "residual"
    form = Form(intermittent=True)
    acceptance = Acceptance(above=0.0)
    coefficients_are = (("power", "W"),)
    shape_is = (("first_start", "s"), ("time_on", "s"), ("time_off", "s"))
    confusions = (
        Confusion("brake_power", "let the arm stand: a fan continues to switch"),
        Confusion("winding_temperature", "hold a load at rest for minutes: windings warm steadily, a fan switches"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        ones = [np.ones(len(run.time)) for run in runs]
        found = levels([course[:, 0] for course in residual], ones, [run.step for run in runs], SHORTEST)
        spans = [(runs[i].index, float(runs[i].time[a]), float(runs[i].time[b])) for i, a, b in found]
        if not spans:
            return []
        listed = (-1.0, *(float(x) for span in spans for x in span))
        return [listed, *_cycles(runs, spans)]

    def charge(self, runs: Sequence[States], shape: Shape) -> float:
        return switching_charge(runs, 3 if shape[0] >= 0 else 2 * (len(shape) - 1) // 3)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        if shape[0] < 0:
            return inside(run, shape[1:])[:, None]
        first, on, off = shape
        phase = np.mod(run.time - run.time[0] - first, on + off)
        return np.asarray((run.time - run.time[0] >= first) & (phase < on), np.float64)[:, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        if shape[0] < 0:
            return ()
        return [(max(0.0, shape[0] - 1), shape[0] + 1), (shape[1] - 1, shape[1] + 1), (shape[2] - 1, shape[2] + 1)]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        found = super().parameters(estimate, robot, joint)
        return {"power": found["power"]} if estimate.shape[0] < 0 else found

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        rhythm = ""
        if "time_on" in parameters:
            on, off = parameters["time_on"].value, parameters["time_off"].value
            rhythm = f" ({on:.1f} s on, {off:.1f} s off)"
        return f"A load of {parameters['power']} switches on and off by itself{rhythm}: a fan is missing."


def _cycles(runs: Sequence[States], spans: Sequence[tuple[int, float, float]]) -> list[Shape]:
    """The common cycle of all runs: medians of first start, time on and time off of whole stretches."""
    firsts, ons, offs = [], [], []
    for run in runs:
        own = [(start - run.time[0], end - run.time[0]) for index, start, end in spans if index == run.index]
        if not own:
            continue
        firsts.append(own[0][0])
        length = float(run.time[-1] - run.time[0])
        ons += [end - start for start, end in own if start > 0.5 and end < length - 0.5]
        offs += [after[0] - before[1] for before, after in pairwise(own)]
    if not (firsts and ons and offs):
        return []
    return [(float(np.median(firsts)), float(np.median(ons)), float(np.median(offs)))]
