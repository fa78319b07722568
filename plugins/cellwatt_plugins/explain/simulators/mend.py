"""Write the physics found into the user's simulator, and measure its error on motion left out of the fit."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt_plugins.explain.explain import Explained
from cellwatt_plugins.explain.fit.leave_out import LeaveOut, compared, rms
from cellwatt_plugins.explain.fit.problem import Problem
from cellwatt_plugins.explain.fit.retuning import all_fixed, confirmed, freed, links_fixed
from cellwatt_plugins.explain.fit.search.solve import fitted
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.model import FittedTerm
from cellwatt_plugins.explain.simulators.correction import (
    correction,
    expressed,
    holds,
    of_coupled,
    remainder,
    why_unwritten,
)
from cellwatt_plugins.explain.simulators.mujoco import Simulator, load_simulator
from cellwatt_plugins.explain.simulators.placing import Placing, placing
from cellwatt_plugins.explain.simulators.target import Target, expected, target
from cellwatt_plugins.explain.simulators.write_mjcf import write_mjcf
from cellwatt_plugins.explain.simulators.write_urdf import what_urdf_holds, write_urdf
from cellwatt_plugins.explain.simulators.written import Applied, Written
from cellwatt_plugins.explain.verdict.estimates import retuned
from cellwatt_plugins.explain.verdict.findings import ErrorOfChannel
from cellwatt_plugins.robot import Body
from cellwatt_plugins.robot.effects.states import States

RISES = 1.01
"""Factor on a joint's error on data left out above which a file is worse."""
POSES = 60
SAME = 1e-3
"""Share of a joint's torque by which the written file's torque may differ from the intended one."""
WORTH = 0.02
"""Share of the noise floor above which residual torque is reported."""


@dataclass(frozen=True)
class Unwritten:
    """Finding that is not in the mended file."""

    effect: str
    joint: int | None
    """1-based: the joint whose torque it is; None for the supply."""
    why: str
    rms: float
    unit: str


@dataclass(frozen=True)
class Mended:
    """A mended simulator."""

    path: Path
    applied: tuple[Applied, ...]
    left: tuple[Unwritten, ...]
    error: tuple[ErrorOfChannel, ...]
    """On blocks left out of the fit of the written numbers."""
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """For ``findings.json``."""
        return {**asdict(self), "path": str(self.path)}


def to_mend(path: Path, body: Body) -> Placing:
    """Load a user's file and locate the URDF's frames in it. Raises ``ConfigError`` if it cannot be used."""
    return placing(load_simulator(path, body.names), body)


def mend(found: Explained, runs: Sequence[Run], user: Placing, out: Path) -> Mended:
    """Write ``out/NAME.mended.xml`` (or ``.urdf``) with the findings, and compare it with the recordings.

    The effects that the file can hold are fitted anew without the others. More and more numbers keep the user's values
    until the error on data left out rises at no joint. Raises ``ConfigError`` if the file cannot be changed, or would
    be worse whatever is written.
    """
    worse = list[str]()
    for solution in _choices(found):
        error = _held_out(user, found, solution, runs)
        worse = [each.channel for each in error if each.after > RISES * each.before]
        if worse:
            continue
        return finished(found, solution, user, target_of(user, solution, found.model.baseline.mounted), error, out)
    raise ConfigError(
        f"{user.simulator.path}: not mended: whatever is written, its error on data left out would rise at "
        f"{', '.join(worse)}; what was found is in findings.json and model.yaml"
    )


def _choices(found: Explained) -> Iterator[Solution]:
    """Fits of what the file can hold: all of it first, then with more and more numbers at the user's values."""
    torque = found.torque
    free = torque.free or torque.problem
    arm = free.states[0].arm
    terms = [term for term in torque.terms if holds(term) and not of_coupled(term, arm)]
    for factors in (confirmed(free, terms, torque.factor), links_fixed(free), all_fixed(free)):
        yield fitted(freed(free, factors), terms)
    # Then, joint by joint, the terms that do not improve their joint are removed.
    problem = freed(free, all_fixed(free))
    folds, remaining = LeaveOut(problem, torque.factor), list(terms)
    for joint in problem.observed:
        others = [t for t in remaining if t.joint != joint]
        if compared(folds.errors(others), folds.errors(remaining), [joint]).share <= 0:
            remaining = others
    yield fitted(problem, remaining)


def target_of(user: Placing, solution: Solution, mount: Float | None) -> Target:
    """Values to be written, as far as the kind of file can hold them."""
    states = solution.problem.states
    terms = [FittedTerm(term, solution.coefficients(term)) for term in solution.terms]
    found = correction(retuned(solution, None), terms, states, mount)
    goal = target(user, found, states, solution.problem.floor)
    return what_urdf_holds(user.simulator, goal) if user.simulator.path.suffix.lower() == ".urdf" else goal


def finished(
    found: Explained, solution: Solution, user: Placing, goal: Target, error: tuple[ErrorOfChannel, ...], out: Path
) -> Mended:
    """Write the numbers of ``goal`` into ``out``, and list the findings that are not among them.

    Raises ``ConfigError`` if the file cannot be changed.
    """
    written = write(user.simulator, goal, out)
    verify(user, goal, solution.problem.states[0], solution.problem.floor, written)
    left = _unwritten(found, solution, [*goal.refused, *written.refused])
    notes = (*user.simulator.notes, *user.notes, *goal.notes)
    return Mended(written.path, tuple(written.applied), tuple(left), error, notes)


def write(simulator: Simulator, goal: Target, folder: Path) -> Written:
    """Write a changed copy of the user's file into ``folder``. Raises ``ConfigError``."""
    if simulator.path.suffix.lower() == ".urdf":
        return write_urdf(simulator, goal, folder)
    return write_mjcf(simulator, goal, folder)


def verify(user: Placing, goal: Target, states: States, floor: Float, written: Written) -> None:
    """Delete the written files and raise ``ConfigError`` if its torques in random poses are not the intended ones."""
    simulator, rng = user.simulator, np.random.default_rng(1)
    shape = POSES, len(simulator.joints)
    motion = rng.uniform(-2, 2, shape), rng.uniform(-1, 1, shape), rng.uniform(-3, 3, shape)
    wanted = expected(user, goal, states, *motion)
    off = rms(_mended(simulator, written)[0].torque(*motion, leading=False) - wanted)
    added = rms(wanted - simulator.torque(*motion, leading=False))
    share = off / (SAME * np.maximum(rms(wanted), floor) + user.off * added)
    if np.max(share) > 1:
        for file in written.files:
            file.unlink()
        worst = int(np.argmax(share))
        raise ConfigError(
            f"{simulator.path}: cannot be mended: joint {simulator.joints[worst]} would be off by {off[worst]:.3g} "
            f"{simulator.unit(worst, 'Nm')} (something in the file overrules the attributes of its joints and "
            "bodies, e.g. inertiafromgeom, settotalmass, fusestatic)"
        )


def _mended(simulator: Simulator, written: Written) -> tuple[Simulator, Float]:
    """The written simulator, and the ratio (n,) of its gears to the user's, which is true over measured torque."""
    new = load_simulator(written.path, simulator.joints)
    factor = new.actuators().gains / simulator.actuators().gains
    return new, np.where(np.isnan(factor), 1.0, factor)


def _held_out(user: Placing, found: Explained, solution: Solution, runs: Sequence[Run]) -> tuple[ErrorOfChannel, ...]:
    """Errors of the torque before and after mending; each block is tested on a file mended without its fold."""
    simulator, problem = user.simulator, solution.problem
    folds = LeaveOut(problem, solution.factor)
    measured = problem.stack([run.torque for run in runs])
    motion = [problem.stack([getattr(s, name) for s in problem.states]) for name in ("q", "qd", "qdd")]
    before = measured - simulator.torque(*motion)
    after = np.empty_like(before)
    for k, coefficients in enumerate(folds.coefficients(solution.terms)):
        rows = folds.fold == k
        with tempfile.TemporaryDirectory() as folder:
            goal = target_of(user, solution.with_coefficients(coefficients), found.model.baseline.mounted)
            new, factor = _mended(simulator, write(simulator, goal, Path(folder)))
        after[rows] = measured[rows] - new.torque(*(course[rows] for course in motion)) / factor
    errors = problem.rms(before), problem.rms(after)
    return tuple(ErrorOfChannel.at(problem, c, *errors) for c in problem.observed)


def _unwritten(found: Explained, solution: Solution, refused: Sequence[tuple[str, int | None, str]]) -> list[Unwritten]:
    """Findings that the file cannot hold, with the rms torque or power of each."""
    problem, why = found.torque.problem, {(effect, joint): text for effect, joint, text in refused}
    arm, out = problem.states[0].arm, []
    for term in found.model.terms:
        effect, joint = term.term.effect, term.term.joint
        if (effect.name, joint) in why:
            course = [term.course(s) for s in problem.states]
            out += _entries(effect.name, why.pop((effect.name, joint)), course, problem)
        elif effect.place == "supply":
            states = (problem if found.supply is None else found.supply.problem).states
            course = [remainder(term, s, states) for s in states]
            size = float(rms(np.concatenate(course))[0])
            out.append(Unwritten(effect.name, None, why_unwritten(term, arm), size, "W"))
        elif not expressed(effect) or of_coupled(term.term, arm):
            course = [remainder(term, s, problem.states) for s in problem.states]
            out += _entries(effect.name, why_unwritten(term, arm), course, problem)
    if reason := next((text for (effect, _), text in why.items() if effect == "rotor_inertia"), None):
        rotor = retuned(solution, None).rotor_inertia
        out += _entries("rotor_inertia", reason, [rotor * s.qdd for s in problem.states], problem)
    return out


def _entries(effect: str, why: str, course: Sequence[Float], problem: Problem) -> list[Unwritten]:
    """One entry for each joint at which the torque ``course``, (N, n) Nm per run, exceeds ``WORTH``."""
    size = rms(np.concatenate(course))
    joints, robot = np.flatnonzero(size > WORTH * problem.floor), problem.states[0].robot
    return [Unwritten(effect, j + 1, why, float(size[j]), robot.unit(j, "N*m")) for j in joints.tolist()]
