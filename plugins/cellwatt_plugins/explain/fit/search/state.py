"""State that the steps of a search share: the task, the present problem, and the terms refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.problem import Place, Problem, Term
from cellwatt_plugins.explain.fit.retuning import loose
from cellwatt_plugins.explain.fit.search.budget import now
from cellwatt_plugins.explain.fit.sides import MOVES
from cellwatt_plugins.explain.fit.solution import Candidate, Solution, Trial
from cellwatt_plugins.explain.fit.thresholds import Thresholds
from cellwatt_plugins.robot.blocks import Block
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.effect import Effect

Make = Callable[[Float, float], Problem]
"""Makes the problem for friction (C,) Nm beyond the nominal that turns over with the velocity's sign, read so many s
late."""


@dataclass
class SearchState:
    """One search on one side of the arm."""

    make: Make
    thresholds: Thresholds
    effects: tuple[Effect, ...]
    """Those of this side."""
    turning: Float
    """The friction (C,) Nm that the problem was made for."""
    problem: Problem
    """Nominal parameters alone; terms are fitted beside them."""
    blocks: dict[Place, list[Block]] = field(default_factory=dict)
    """All shapes of the effects whose columns depend on the motion alone, or are costly."""
    loads: dict[Place, Float] = field(default_factory=dict)
    """Load (N,) Nm at the joint with which those of costly effects were simulated."""
    solved: dict[tuple[Term, ...], Solution] = field(default_factory=dict)
    """The last solutions of the present problem."""
    refused: dict[Place, Trial] = field(default_factory=dict)
    """The last reason why a candidate did not enter or a term left."""

    unlooked: set[int | None] = field(default_factory=set)
    """Joints (0-based) at which no candidate has been refused since a term last entered there."""
    left: tuple[tuple[Term, ...], list[Float]] | None = None
    """What some terms leave at all samples of each run."""
    late: float = 0.0
    """s after the motion at which the problem's torques were read."""
    looseness: float = 1.0
    """See ``loose``."""
    known: dict[tuple[str, int | None, frozenset[Term]], Candidate | None] = field(default_factory=dict)
    """What an effect would add at a joint (0-based) beside the terms that act there."""
    powered: bool = False
    """True where the supply tells what is friction and what is in the measurement."""
    until: float = float("inf")
    """s at which nothing more is tried; see ``now``."""

    def spent(self) -> bool:
        """True once the time is up: the search then reports what it has found."""
        return now() > self.until

    def changed(self, *joints: int | None) -> None:
        """Note that a term entered or left at ``joints``, None for the whole arm: they are to be looked at again."""
        self.unlooked |= set(self.moving) if None in joints else set(joints)

    def turn(self, turning: Sequence[float], late: float) -> None:
        """Make the problem anew where another friction (C,) Nm turns over with the sign of the velocity.

        The torque shows that ``late`` s after.
        """
        if not np.array_equal(turning, self.turning) or late != self.late:
            self.turning, self.late = np.array(turning), late
            self._anew()

    def loosen(self, looseness: float) -> None:
        """Begin anew with other tolerances; see ``loose``."""
        self.looseness, self.turning, self.late = looseness, np.zeros_like(self.turning), 0.0
        self._anew()

    def _anew(self) -> None:
        # What motion and priors alone determine stays; the weight of each sample does not.
        old = self.problem
        self.problem = replace(
            loose(self.make(self.turning, self.late), self.looseness), simulated=old.simulated, made=old.made
        )
        self.solved.clear()
        self.known.clear()
        self.left = None

    def use(self, problem: Problem) -> None:
        """Go on with the same problem under other priors."""
        self.problem = problem
        self.solved.clear()

    def every_sample(self, now: Solution) -> list[Float]:
        """What a solution leaves at all samples of each run, (N, C)."""
        key = tuple(now.terms)
        if self.left is None or self.left[0] != key:
            self.left = key, now.problem.every_sample(now.residual)
        return self.left[1]

    @cached_property
    def moving(self) -> list[int]:
        """Joints (0-based) that move and of which torque was read: nothing else can be told of a joint."""
        if self.problem.side == "supply":
            travel = np.max([np.ptp(s.q, axis=0) for s in self.problem.states], axis=0)
            return [int(joint) for joint in np.flatnonzero(travel > MOVES)]
        return self.problem.told

    @property
    def robot(self) -> RobotDescription:
        """The arm as described."""
        return self.problem.states[0].robot

    def refuse(self, term: Term, gain: float, why: str) -> None:
        """Note why a term is not there, and the log evidence that it would add."""
        self.refused[term.place] = Trial.of(term, gain, False, why)
