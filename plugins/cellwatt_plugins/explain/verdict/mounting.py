"""The mount of the arm, checked before the physics: whether gravity points as in the simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.verdict.findings import Finding, Improvement, Where
from cellwatt_plugins.robot.effects.effect import Parameter
from cellwatt_plugins.robot.effects.load.gravity_tilt import AXES, turned
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.mount import mount


@dataclass(frozen=True)
class Mounting:
    """A mount that differs from the simulation's."""

    finding: Finding
    was: Float
    """Gravity (3,) m/s² of the simulation, in the base's frame."""
    before: Float
    """Rms torque errors (n,) in that gravity; 0 where no torque was measured."""

    def with_tilt(self, found: Sequence[Finding]) -> list[Finding]:
        """The findings, the first of them that of the mount, which takes up a tilt that was found beside it: both are
        one fact, the direction of gravity."""
        mounted, *others = found
        tilt = next((each for each in others if each.effect == mounted.effect), None)
        if tilt is None:
            return [mounted, *others]
        field = np.array([each.value for each in mounted.parameters.values()])
        ways = turned(field, tuple(float(AXES.index(axis)) for axis in tilt.parameters))
        turns = np.array([(each.value, each.std) for each in tilt.parameters.values()])
        std = np.sqrt(np.square(turns[:, 1]) @ np.square(ways))
        field = field + turns[:, 0] @ ways
        field *= np.linalg.norm(self.was) / np.linalg.norm(field)
        exact = replace(mounted, statement=_statement(self.was, field), parameters=_parameters(field, std))
        return [exact, *(each for each in others if each is not tilt)]


def as_mounted(
    runs: Sequence[Run], states: Sequence[States], base: Baseline
) -> tuple[Baseline, Sequence[States], Mounting | None]:
    """Baseline and states with the gravity found from the recordings; unchanged where the simulation's is right."""
    q, qd, qdd = (np.concatenate([getattr(s, name) for s in states]) for name in ("q", "qd", "qdd"))
    found = mount(states[0].arm.body, q, qd, qdd, _residual(runs, states))
    if found is None:
        return base, states, None
    base = replace(base, recorded=base.recorded.with_gravity(found.field))
    new = [replace(s, arm=base.recorded, fitted=None, carried=None) for s in states]
    was, before, after = base.arm.body.gravity_field, _errors(runs, states), _errors(runs, new)
    gone = before - after
    best = int(np.argmax(gone))
    felt = tuple(f"tau_{j + 1}" for j in np.flatnonzero(gone > 0.1 * gone[best]))
    unit = base.arm.description.unit(best, "N*m")
    error = Improvement(f"tau_{best + 1}", unit, float(before[best]), float(after[best]), 0.0, False)
    told = _statement(was, found.field), _parameters(found.field, found.std)
    finding = Finding("gravity_tilt", None, "missing", 0.99, *told, Where(felt), error)
    return base, new, Mounting(finding, was, before)


def _errors(runs: Sequence[Run], states: Sequence[States]) -> Float:
    """Rms (n,) Nm of measured minus simulated torque; 0 where no torque was measured."""
    off = _residual(runs, states)
    read = np.isfinite(off)
    return np.asarray(np.sqrt(np.sum(np.where(read, off, 0.0) ** 2, axis=0) / np.maximum(np.sum(read, axis=0), 1)))


def _residual(runs: Sequence[Run], states: Sequence[States]) -> Float:
    return np.concatenate([run.torque - s.nominal for run, s in zip(runs, states, strict=True)])


def _parameters(field: Float, std: Float) -> dict[str, Parameter]:
    each = zip("xyz", field.tolist(), std.tolist(), strict=True)
    return {f"gravity_{axis}": Parameter(value, spread, "m/s^2") for axis, value, spread in each}


def _statement(was: Float, now: Float) -> str:
    return (
        f"The base is mounted differently from the simulation: in its frame gravity is {_vector(now)} m/s², not "
        f'{_vector(was)}. In an MJCF, set <option gravity="{_vector(now)[1:-1].replace(",", "")}"/> if the base '
        "is not turned."
    )


def _vector(field: Float) -> str:
    return "(" + ", ".join(f"{value + 0.0:.2f}" for value in field) + ")"
