"""Choose from the library the experiment with the most expected evidence on what the recordings leave open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cellwatt.errors import RecordingError, why
from cellwatt_plugins.mismatch.experiments.expected_motion import expected_states
from cellwatt_plugins.mismatch.experiments.library import Experiment, arm_experiments, joint_experiments
from cellwatt_plugins.mismatch.experiments.limits import Limits, limits_of
from cellwatt_plugins.mismatch.experiments.objectives import SURE, ExpectedRun, Objective, objectives_of
from cellwatt_plugins.mismatch.experiments.trajectory import Trajectory
from cellwatt_plugins.mismatch.explain import Explained
from cellwatt_plugins.mismatch.input.run import Motion
from cellwatt_plugins.robot.effects.states import States

MOST = 3
"""Experiments suggested at once."""
OFTEN = 5
"""Times that an experiment is repeated in the motion at most."""
LEAST = SURE / OFTEN
"""nats: an experiment that is expected to add less does not help."""
SHOWN = 4
"""Objectives of an experiment that are written out."""
AMPLE = 3 * SURE
"""nats to one objective beyond which more are of no use."""
ROWS = 6000
"""Samples in which an experiment is looked at, about."""


@dataclass(frozen=True)
class ExpectedGain:
    """Evidence that an experiment is expected to add towards an objective."""

    objective: Objective
    nats: float
    """Log evidence, one time through."""


@dataclass(frozen=True, eq=False)
class Chosen:
    """An experiment with the objectives that it meets."""

    experiment: Experiment
    gains: tuple[ExpectedGain, ...]

    @property
    def seconds(self) -> float:
        """Duration in s for 95 % certainty on all objectives; evidence is taken to grow evenly."""
        once = self.experiment.trajectory.seconds
        return max(max(once * SURE / a.nats, a.objective.least_time) for a in self.gains)

    @property
    def times(self) -> int:
        """Repetitions for 95 % certainty."""
        return max(1, int(np.ceil(self.seconds / self.experiment.trajectory.seconds)))


@dataclass(frozen=True, eq=False)
class Suggestion:
    """Experiments to run, as one motion, and what remains open after them."""

    chosen: tuple[Chosen, ...]
    motion: Motion | None
    """None where no experiment is called for, or none would help."""
    open: tuple[Objective, ...]
    refused: Mapping[str, str]
    """Experiments left out and the limit that they would break."""
    limits: Limits


def suggest(found: Explained) -> Suggestion:
    """The experiments that best answer what the recordings leave open.

    That is which of two names is right; where no two are close, whether effects are there that the motion could not
    show.
    """
    states = found.torque.problem.states
    limits = limits_of(states)
    objectives = objectives_of(found, limits)
    table, refused = _table(found, limits, objectives)
    chosen = choose(table)
    met = {id(gain.objective) for one in chosen for gain in one.gains}
    motion = _motion(chosen, _step(states)) if chosen else None
    still = tuple(q for q in objectives if id(q) not in met)
    return Suggestion(chosen, motion, still, refused, limits)


def choose(table: Mapping[Experiment, Sequence[ExpectedGain]]) -> tuple[Chosen, ...]:
    """One experiment after the other: of those that meet an objective the one with most nats a second."""
    left = dict(table)
    out: list[Chosen] = []
    settled: set[int] = set()
    while left and len(out) < MOST:
        best = max(left, key=lambda e: _worth(e, left[e], settled))
        gains = tuple(a for a in left.pop(best) if id(a.objective) not in settled and a.nats > LEAST)
        if not gains:
            break
        sure = tuple(a for a in gains if a.nats >= SURE) or gains
        out.append(Chosen(best, sure))
        settled |= {id(a.objective) for a in sure}
    return tuple(out)


def _worth(experiment: Experiment, gains: Sequence[ExpectedGain], settled: set[int]) -> tuple[bool, float]:
    nats = [a.nats for a in gains if id(a.objective) not in settled]
    useful = sum(min(max(n, 0.0), AMPLE) for n in nats)
    return any(n >= SURE for n in nats), useful / experiment.trajectory.seconds


def _table(
    found: Explained, limits: Limits, objectives: Sequence[Objective]
) -> tuple[dict[Experiment, list[ExpectedGain]], dict[str, str]]:
    """Return the gain towards each objective of experiments that keep the limits, and why others are left out."""
    states = found.torque.problem.states
    table: dict[Experiment, list[ExpectedGain]] = {}
    refused: dict[str, str] = {}
    for joint, experiment in _library(limits, states, objectives):
        step = max(_step(states), experiment.trajectory.seconds / ROWS)
        motion = experiment.trajectory.sampled(step)
        expected = expected_states(experiment.name, motion, found.model, states)
        broken = limits.broken(motion, expected.torque)
        if broken is not None:
            refused[experiment.name] = broken
            continue
        run = ExpectedRun(experiment, expected, joint)
        table[experiment] = [ExpectedGain(q, q.nats(run) if q.suits(joint) else 0.0) for q in objectives]
    return table, refused


def _library(
    limits: Limits, states: Sequence[States], objectives: Sequence[Objective]
) -> list[tuple[int | None, Experiment]]:
    """Experiments on all joints, and on those that the objectives are about, each with its joint."""
    if not objectives:
        return []
    out: list[tuple[int | None, Experiment]] = [(None, experiment) for experiment in arm_experiments(limits, states)]
    for joint in sorted({joint for objective in objectives for joint in objective.joints}):
        out += [(joint, experiment) for experiment in joint_experiments(limits, states, joint)]
    return out


def _step(states: Sequence[States]) -> float:
    rate = states[0].robot.sample_rate
    return states[0].step if rate is None else 1 / rate


def _motion(chosen: Sequence[Chosen], step: float) -> Motion:
    """All chosen experiments, each as often as it takes, at most ``OFTEN`` times; they start and end at home."""
    pieces = [p for one in chosen for _ in range(min(one.times, OFTEN)) for p in one.experiment.trajectory.pieces]
    return Trajectory(tuple(pieces)).sampled(step)


def write_suggestion(motion: Motion, path: Path) -> None:
    """Write t, q_1 …, qd_1 …, qdd_1 … as CSV in s, rad, rad/s, rad/s². Raises ``RecordingError``."""
    joints = range(1, motion.position.shape[1] + 1)
    names = ["t", *(f"{name}_{i}" for name in ("q", "qd", "qdd") for i in joints)]
    rows = np.column_stack([motion.time, motion.position, motion.velocity, motion.acceleration])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, rows, fmt="%.7f", delimiter=",", header=",".join(names), comments="")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {why(error)}") from error


def suggestion_in_words(suggestion: Suggestion, path: Path) -> str:
    """Describe for the terminal the experiment to run, its duration and what it will tell."""
    if not suggestion.chosen and not suggestion.open:
        return "nothing to suggest: no two names are close, and the motion could show every effect"
    lines = [line for one in suggestion.chosen for line in _chosen(one)]
    lines += [f"no experiment here would {objective.aim}; {objective.instead}" for objective in suggestion.open]
    lines += [f"  left out: {name}, {broken}" for name, broken in suggestion.refused.items()]
    if suggestion.motion is not None:
        lines += _motion_in_words(suggestion.motion, suggestion.limits, path)
    return "\n".join(lines)


def _chosen(one: Chosen) -> list[str]:
    once = one.experiment.trajectory.seconds
    asked = [f"{gain.objective.aim} (expected evidence {gain.nats:.3g} nats)" for gain in one.gains]
    shown = [*asked[:SHOWN], *([f"and {len(asked) - SHOWN} more"] if len(asked) > SHOWN else [])]
    often = "once through is enough" if one.times == 1 else f"run it {one.times} times"
    cold = "; start with a cold arm" if any(gain.objective.least_time > 0 for gain in one.gains) else ""
    return [
        f"suggested: {one.experiment.name}, {once:.0f} s: {one.experiment.does}",
        *(f"    to {line}" if i < SHOWN else f"    {line}" for i, line in enumerate(shown)),
        f"    95 % sure after about {max(one.seconds, 1):.0f} s: {often}{cold}",
    ]


def _motion_in_words(motion: Motion, limits: Limits, path: Path) -> list[str]:
    home = ", ".join(f"{x:.3f}" for x in limits.home)
    ranges = ", ".join(
        f"{low:.2f} … {high:.2f}" for low, high in zip(motion.position.min(0), motion.position.max(0), strict=True)
    )
    fastest, hardest = np.max(np.abs(motion.velocity)), np.max(np.abs(motion.acceleration))
    return [
        f"written to {path}: {motion.time[-1]:.0f} s, starts and ends at rest at ({home}) rad",
        f"  joints between ({ranges}) rad, at most {fastest:.2f} rad/s and {hardest:.2f} rad/s²; the limits of the "
        "joints are kept, obstacles are not known here: try it slowly first",
        f"  then record it, and give cellwatt explain this recording too, with {path.name} as its --simulation",
    ]
