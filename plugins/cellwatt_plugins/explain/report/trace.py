"""One recording as the report draws it, and the computations between recording and figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.model import Model, predict_states
from cellwatt_plugins.robot.samples import Even


@dataclass(frozen=True)
class Trace(Even):
    """One recording of n joints with its two predictions; N samples, C channels, NaN where unknown."""

    name: str
    """Name of the recording, as in ``Span.recording``."""
    time: Float
    """(N,) s, evenly spaced."""
    position: Float
    """(N, n) rad."""
    velocity: Float
    """(N, n) rad/s."""
    channels: tuple[str, ...]
    """``tau_1`` … ``tau_n``, ``power`` where recorded."""
    units: tuple[str, ...]
    """Units of the channels."""
    measured: Float
    """(N, C)."""
    simulation: Float
    """(N, C), as given."""
    model: Float
    """(N, C), with the findings."""

    def column(self, values: Float, channel: str) -> Float:
        """(N,) of one channel out of (N, C) ``values``; NaN where this recording lacks the channel."""
        if channel not in self.channels:
            return np.full(len(self.time), np.nan)
        return np.asarray(values[:, self.channels.index(channel)], np.float64)

    def residual(self, channel: str, prediction: Float) -> Float:
        """(N,) measured minus ``prediction`` (N, C)."""
        return self.column(self.measured, channel) - self.column(prediction, channel)


def traces_of(runs: Sequence[Run], model: Model, solution: Solution) -> list[Trace]:
    """One trace per run, at all samples; ``solution`` holds the runs' states."""
    out, joints = [], range(len(model.robot.joints))
    for run, states in zip(runs, solution.problem.states, strict=True):
        full = predict_states(model, states)
        powered = run.power is not None
        names = (*(f"tau_{i + 1}" for i in joints), *["power"] * powered)
        units = (*(model.robot.unit(i, "N*m") for i in joints), *["W"] * powered)
        power = states.with_torque(states.nominal).nominal_power
        measured, stated, modelled = (
            torque if run.power is None or p is None else np.column_stack([torque, p])
            for torque, p in ((run.torque, run.power), (states.nominal, power), (full.torque, full.power))
        )
        out.append(Trace(run.name, run.time, states.q, states.qd, names, units, measured, stated, modelled))
    return out


def joint_of(channel: str) -> int | None:
    """1-based joint of a torque channel, None for the supply."""
    head, _, number = channel.partition("_")
    return int(number) if head == "tau" and number.isdigit() else None


def mechanical_power(trace: Trace) -> Float:
    """(N,) W that the joints give to the arm, Σ τ·ω of the measured torques; NaN where a torque is missing."""
    torques = [trace.column(trace.measured, f"tau_{j + 1}") for j in range(trace.velocity.shape[1])]
    return np.asarray((np.stack(torques, axis=1) * trace.velocity).sum(axis=1), np.float64)


def root(values: Float) -> Float:
    """Signed square root: widens low speeds, where friction shows."""
    return np.asarray(np.sign(values) * np.sqrt(np.abs(values)), np.float64)


def unroot(values: Float) -> Float:
    """The inverse of ``root``."""
    return np.asarray(np.sign(values) * values**2, np.float64)


def telling_stretch(trace: Trace, channel: str, length: float) -> tuple[float, float]:
    """Start and end in s of the stretch of ``length`` s with the largest error of the simulation."""
    start, end = float(trace.time[0]), float(trace.time[-1])
    width = max(int(length / trace.step), 1)
    if width >= len(trace.time):
        return start, end
    squared = np.nan_to_num(trace.residual(channel, trace.simulation) ** 2, posinf=0.0)
    total = np.concatenate([[0.0], np.cumsum(squared)])
    first = int(np.argmax(total[width:] - total[:-width]))
    return float(trace.time[first]), float(trace.time[first]) + length


def worst_first(traces: Sequence[Trace], floors: Mapping[str, float], most: int) -> list[Trace]:
    """The ``most`` traces with the largest error of the simulation, in the order given."""

    def off(trace: Trace) -> float:
        squares = [(trace.residual(c, trace.simulation) / floor) ** 2 for c, floor in floors.items()]
        return float(sum(np.mean(s[np.isfinite(s)]) for s in squares if np.isfinite(s).any()))

    chosen = sorted(range(len(traces)), key=lambda i: -off(traces[i]))[:most]
    return [traces[i] for i in sorted(chosen)]
