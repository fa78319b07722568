"""Units that are often confused, recognised by their factor; wording shared by several checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt.report.numbers import number
from cellwatt_plugins.explain.input.run import Run

DEGREES = float(np.degrees(1.0))
RPM = 30 / np.pi
MOVES = 0.05
"""Travel, rad, above which a joint certainly moves."""


def recognised(factor: float, known: Mapping[str, float], within: float) -> str | None:
    """The name of the known factor nearest to ``factor`` (> 0); None where none is ``within`` this ratio."""
    far = {name: abs(np.log(factor / value)) for name, value in known.items()}
    name = min(far, key=far.__getitem__, default=None)
    return name if name is not None and far[name] < np.log(within) else None


def wrong_unit(what: str, factor: float, right: str, known: Mapping[str, float], within: float = 1.25) -> str:
    """Sentence on a quantity that is ``factor`` times the ``right`` one, with the name of the factor if it is known."""
    name = recognised(factor, known, within)
    return f"{what} is {number(factor)} times {right}" + (f": it seems to be {name}" if name else "")


def joints_text(numbers: Sequence[int]) -> str:
    """``joint 2``, or ``joints 2, 3``; numbers from 1."""
    return f"joint{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"


def order_text(stem: str, order: Sequence[int]) -> str:
    """``q_1 holds joint 3, q_3 holds joint 1``; ``order`` counts from 0."""
    return ", ".join(f"{stem}_{i + 1} holds joint {j + 1}" for i, j in enumerate(order) if i != j)


def usable(run: Run, most: int | None = None) -> NDArray[np.intp]:
    """Indices of the samples of a run that were not filled in; about ``most`` at most, evenly spread."""
    indices = np.flatnonzero(~run.filled)
    return indices if most is None else indices[:: max(1, len(indices) // most)]
