"""Mass that is picked up and put down during the recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Form, Relations, Uncertainty
from cellwatt_plugins.robot.effects.effect import Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.load.payload import Payload
from cellwatt_plugins.robot.effects.load.schedule import levels, switching_charge
from cellwatt_plugins.robot.effects.states import States

TYPICAL = np.array([1.0, 0.0, 0.0, 0.05, *(6 * [0.0])])
"""A body of 1 kg in front of the flange, (10,), with which the search for the stretches begins."""
SHORTEST = 0.4
"""Shortest time in s for which a part is carried."""


class PayloadChange(Payload):
    """A payload that is present during some stretches. Shape: run, start, end, run, start, end, …"""

    name = "payload_change"
    depends_on = "residual"
    form = Form(intermittent=True)
    relations = Relations()
    uncertainty = Uncertainty({"first_picked_up": 0.0}, torque_gain=("mass",))
    plausible = None
    confusions = (Confusion("external_contact", "repeat the same program without the part"),)
    sentence = (
        "The flange carries {mass} during parts of the recording, first from "
        "{first_picked_up:.2f} s: a payload is picked up and put down."
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        found = _carried(runs, residual, TYPICAL)
        return [] if found is None else [found]

    def reshaped(self, runs: Sequence[States], joint: int | None, course: Sequence[Float], own: Float) -> Shape | None:
        return _carried(runs, course, own / own[0])

    def charge(self, runs: Sequence[States], shape: Shape) -> float:
        return switching_charge(runs, 2 * len(shape) // 3)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return run.regressor[:, :, -10:] * inside(run, shape)[:, None, None]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        first = Parameter(float(estimate.shape[1]), 0.0, "s")
        return {**super().parameters(estimate, robot, joint), "first_picked_up": first}


def inside(run: States, shape: Shape) -> Float:
    """1 (N,) within the stretches of a shape, else 0."""
    out = np.zeros(len(run.time))
    for index, start, end in zip(shape[::3], shape[1::3], shape[2::3], strict=True):
        if int(index) == run.index:
            out[(run.time >= start) & (run.time <= end)] = 1.0
    return out


def _carried(runs: Sequence[States], residual: Sequence[Float], body: Float) -> Shape | None:
    """Stretches during which a multiple of ``body`` (10,) is on the flange; None if there are none."""
    courses = [_mass_course(run, course, body) for run, course in zip(runs, residual, strict=True)]
    masses, weights = zip(*courses, strict=True)
    found = levels(masses, weights, [run.step for run in runs], SHORTEST)
    spans = [(runs[i].index, runs[i].time[a], runs[i].time[b]) for i, a, b in found]
    return tuple(float(x) for span in spans for x in span) or None


def _mass_course(run: States, residual: Float, body: Float) -> tuple[Float, Float]:
    """Multiple (N,) of ``body`` (10,) that fits each sample's residual, and its weight."""
    typical = run.regressor[:, :, -10:] @ body
    size = 1 / np.maximum(np.var(residual, axis=0), 1e-12)
    weight = np.sum(typical**2 * size, axis=1)
    return np.sum(typical * residual * size, axis=1) / np.maximum(weight, 1e-12), weight
