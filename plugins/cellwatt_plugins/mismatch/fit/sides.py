"""The problem of each side of the arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.fit.problem import Problem, torque_problem
from cellwatt_plugins.mismatch.fit.retuning import loose
from cellwatt_plugins.mismatch.input.run import Run
from cellwatt_plugins.robot.effects.states import States

Float = NDArray[np.float64]


class Torques:
    """Makes the problem of the joints' torques; that without friction beyond the nominal is made once."""

    def __init__(self, runs: Sequence[Run], states: Sequence[States]) -> None:
        self._runs, self._states = tuple(runs), tuple(states)
        self._plain: Problem | None = None

    def __call__(self, turning: Float, looseness: float = 1.0, /) -> Problem:
        """The problem for friction (n,) Nm beyond the nominal that turns over with the velocity's sign.

        ``looseness`` is a factor on the tolerances of the links.
        """
        if turning.any() or looseness != 1.0:
            return torque_problem(self._runs, self._states, turning, looseness)
        if self._plain is None:
            self._plain = torque_problem(self._runs, self._states)
        return self._plain


class Supply:
    """The problem of the supply: friction has no part in it."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem

    def __call__(self, turning: Float, looseness: float = 1.0, /) -> Problem:
        """The problem; ``looseness`` is a factor on the tolerances of standby power and windings."""
        return self._problem if looseness == 1.0 else loose(self._problem, looseness)
