"""State that the steps of a search share: the task, the current problem, and the rejected terms."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cellwatt.arrays import Float
from cellwatt.scheduler import workers
from cellwatt_plugins.explain.fit.problem import Place, Problem, Term
from cellwatt_plugins.explain.fit.retuning import loose
from cellwatt_plugins.explain.fit.solution import Candidate, Solution, Trial
from cellwatt_plugins.explain.fit.thresholds import Thresholds
from cellwatt_plugins.explain.input.factors import MOVES
from cellwatt_plugins.robot.blocks import Block
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.effect import Effect

Make = Callable[[Float, float], Problem]
"""Creates the problem for friction (C,) Nm beyond the nominal that reverses with the velocity, and the delay of the
measured torques in s."""


@dataclass
class SearchState:
    """One search on one side of the arm."""

    make: Make
    thresholds: Thresholds
    effects: tuple[Effect, ...]
    """The effects of this side."""
    turning: Float
    """The friction (C,) Nm for which the problem was created."""
    problem: Problem
    """The problem with nominal parameters alone; terms are fitted beside them."""
    blocks: dict[Place, list[Block]] = field(default_factory=dict)
    """All shapes of the effects whose columns depend on the motion alone, or are costly to compute."""
    loads: dict[Place, Float] = field(default_factory=dict)
    """Load (N,) Nm of the joint with which the costly effects were simulated."""
    solved: dict[tuple[Term, ...], Solution] = field(default_factory=dict)
    """The last solutions of the current problem."""
    refused: dict[Place, Trial] = field(default_factory=dict)
    """The last reason for which a candidate was rejected or a term removed."""

    unsearched: set[int | None] = field(default_factory=set)
    """Joints (0-based) where a term was added and the candidates have not all been rejected since."""
    late: float = 0.0
    """Delay in s of the problem's measured torques."""
    looseness: float = 1.0
    """See ``loose``."""
    known: dict[tuple[str, int | None, frozenset[Term]], Candidate | None] = field(default_factory=dict)
    """What an effect would add at a joint (0-based), given the terms that act there."""
    powered: bool = False
    """True if the supply's power was recorded: it separates friction from errors of the measurement."""
    until: float = float("inf")
    """s after which nothing more is tried; see ``now``."""

    def spent(self) -> bool:
        """True once the time limit is reached: the search then reports what it has found."""
        return now() > self.until

    def changed(self, *joints: int | None) -> None:
        """Note that a term was added or removed at ``joints`` (None: the whole arm), whose candidates must be tried
        again."""
        self.unsearched |= set(self.moving) if None in joints else set(joints)

    def turn(self, turning: Float, late: float) -> None:
        """Create the problem anew for the friction (C,) Nm that reverses with the velocity, and the torque's delay
        ``late`` s."""
        self.turning, self.late = turning, late
        # Results of motion and priors alone remain valid; the weight of each sample changes.
        new = loose(self.make(self.turning, self.late), self.looseness)
        self.problem = replace(new, simulated=self.problem.simulated, made=self.problem.made)
        self.solved.clear()
        self.known.clear()

    def use(self, problem: Problem) -> None:
        """Continue with the same problem under other priors."""
        self.problem = problem
        self.solved.clear()

    @cached_property
    def moving(self) -> list[int]:
        """Joints (0-based) that move and whose torque was measured; other joints give no evidence."""
        if self.problem.side == "supply":
            states = self.problem.states
            travel = np.max([np.ptp(s.q, axis=0) for s in states], axis=0)
            return [int(joint) for joint in np.flatnonzero(travel > MOVES * states[0].arm.body.levers)]
        return self.problem.observed

    @property
    def robot(self) -> RobotDescription:
        """The arm's description."""
        return self.problem.states[0].robot

    def refuse(self, term: Term, gain: float, why: str) -> None:
        """Note the reason why a term is absent, and the log evidence that it would add."""
        self.refused[term.place] = Trial.of(term, gain, False, why)


def now() -> float:
    """Seconds on the clock of a search: CPU time of this process, so that waiting does not count.

    With worker processes it is elapsed time.
    """
    return time.process_time() if workers() is None else time.monotonic()
