"""The problem of the joints' torques, made for what is known of their friction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.fit.problem import Problem, torque_problem
from cellwatt_plugins.mismatch.input.run import Run
from cellwatt_plugins.robot.effects.states import States

Float = NDArray[np.float64]


class Torques:
    """Makes the problem of the joints' torques; that without friction beyond the nominal is made once."""

    def __init__(self, runs: Sequence[Run], states: Sequence[States]) -> None:
        self._runs, self._states = tuple(runs), tuple(states)
        self._plain: Problem | None = None

    def __call__(self, turning: Float, late: float) -> Problem:
        """The problem for friction (n,) Nm beyond the nominal that turns over with the velocity's sign.

        The torques were read ``late`` s after the motion.
        """
        if turning.any() or late:
            return torque_problem(self._runs, self._states, turning, late)
        if self._plain is None:
            self._plain = torque_problem(self._runs, self._states)
        return self._plain
