"""Types of numbers on the command line: each is finite, which ``click.FloatRange`` does not see to."""

from __future__ import annotations

import math
from typing import Any, Final

import click


class FiniteRange(click.FloatRange):
    """A range that holds neither ``nan`` nor an infinity."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number; fails for one that is not finite, or not in the range."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"found {value!r}, expected a finite number", param, ctx)
        return number


FINITE: Final = FiniteRange()
NOT_NEGATIVE: Final = FiniteRange(min=0)
SECONDS: Final = NOT_NEGATIVE
"""A duration in s, or a time since a start."""
