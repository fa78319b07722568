"""The paper's networks, trained by scaled conjugate gradient: its equations (6) to (9), see ``scg``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.progress import steps
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.paper import ROWS, Seen, Traced
from cellwatt_plugins.models.power.perceptron import Perceptron
from cellwatt_plugins.models.power.shown import Shown
from cellwatt_plugins.models.power.terms import Motion
from cellwatt_plugins.onnx_graph import beside

NEURONS: Final = 8
ITERATIONS: Final = 400
HELD: Final = 0.15
"""Share of the rows, in complete moves, that decide when SCG stops."""
ALIKE: Final = 0.3
"""Smallest scale of a network's input, as a share of its standard deviation in the median joint."""


@dataclass(frozen=True)
class Scg:
    """A network for each joint, from motion and load to current, and one from equation (13)'s terms to power."""

    currents: Perceptron
    """The joints' networks, ``stacked``."""
    supply: Perceptron | None
    constant: Float
    """(n,) Nm/A, as stated."""

    @classmethod
    def fit(cls, moves: Moves, seen: Seen) -> Scg:
        """Train all networks; about every seventh move decides when to stop."""
        every = max(2, round(1 / HELD))

        def train(x: Float, y: Float, least: Float, at: NDArray[np.intp]) -> Perceptron:
            sampled = np.flatnonzero(np.isfinite(y).all(axis=1))
            sampled = sampled[:: max(1, len(sampled) // ROWS)]
            held = (moves.move[at[sampled]] % every == every - 1) & (moves.count >= every)
            return Perceptron.train(x[sampled], y[sampled], held, NEURONS, ITERATIONS, least)

        inputs, rows = np.stack(_inputs(seen.motion), axis=2), np.arange(len(moves))
        least = ALIKE * np.median(inputs.std(axis=0), axis=0)
        each = steps(range(moves.joints), "network of joint")
        currents = Perceptron.stacked([train(inputs[:, j], moves.current[:, [j]], least, rows) for j in each])
        found = cls(currents, None, seen.constant)
        shown = Shown.of(moves, rows)
        if not len(shown.power):
            return found
        terms = found._terms(found._currents(seen.motion), seen.motion.qd)
        groups = terms.std(axis=0).reshape(-1, moves.joints + 1)
        least = ALIKE * np.repeat(np.median(groups, axis=1), moves.joints + 1)
        return cls(currents, train(shown.seen(terms), shown.power[:, None], least, shown.at), seen.constant)

    def predict(self, seen: Seen | Traced) -> Any:
        """Power (N,) W and currents (N, n) A of seen moves; of a traced motion, the model file that gives them."""
        current: Any = seen.here(self._currents(seen.motion))
        power = None if self.supply is None else self.supply(self._terms(current, seen.here(seen.motion.qd)))
        return seen.given(power, current)

    def _currents(self, motion: Motion) -> Any:
        return self.currents.by_joint(_inputs(motion))

    def _terms(self, current: Any, qd: Any) -> Any:
        """Copper and mechanical terms of equation (13) by joint and in sum, the latter also as absolute values.

        Power that a drive returns is worth less than power that it draws: with |x| beside x, each has its own weight.
        """
        copper = current * current
        work = self.constant * qd * current
        total = work.sum(axis=-1, keepdims=True)
        return beside([copper, copper.sum(axis=-1, keepdims=True), work, total, np.abs(work), np.abs(total)])


def _inputs(motion: Motion) -> tuple[Any, ...]:
    """Inputs of a joint's network: (N, n) each."""
    return motion.load, motion.qd, motion.qdd, motion.sign
