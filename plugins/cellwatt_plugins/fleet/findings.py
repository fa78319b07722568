"""Results of a fleet as they are written to fleet.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from cellwatt_plugins.fleet.lake import Skipped

Cause = Literal["wears", "rises", "falls", "stepped_up", "stepped_down"]


@dataclass(frozen=True)
class Finding:
    """Something that changed in one arm and in no other of its kind."""

    cell: str
    kind: str
    joint: int | None
    """From 1; None for the whole arm."""
    quantity: str
    """``friction``, or ``energy`` (of a repetition)."""
    what: Cause
    percent: float
    """Change from ``first`` to ``last``, or at a step."""
    low: float
    """End of the 95 % interval of ``percent``."""
    high: float
    percent_a_week: float | None
    """None for a step."""
    first: str
    """Monday of the week from which it is counted, or of the step."""
    last: str
    chance: float
    """Probability of a change as clear by accident, in one course."""
    statement: str
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Weekly:
    """The course of a joint's friction, or of a cell's energy, for drawing; per cent of its mean."""

    cell: str
    joint: int | None
    quantity: str
    weeks: tuple[str, ...]
    percent: tuple[float, ...]
    error: tuple[float, ...]
    """Of one standard deviation."""
    kind: tuple[float, ...]
    """What the kind does together in these weeks, already taken out."""


@dataclass(frozen=True)
class CellSummary:
    """A cell and what was used of it."""

    cell: str
    kind: str
    weeks: int
    repetitions: int
    seconds: float
    temperature: bool
    statement: str


@dataclass(frozen=True)
class Fleet:
    """All that a fleet tells."""

    first: str
    last: str
    weeks: int
    chance_of_false: float
    least_percent: float
    tests: int
    findings: Sequence[Finding]
    cells: Sequence[CellSummary]
    skipped: Sequence[Skipped]
    notes: Sequence[str]
    smallest: Mapping[str, float]
    """Smallest change over all weeks, in per cent, that half the joints of a kind would show; by kind."""
    courses: Sequence[Weekly] = field(default_factory=tuple)

    @property
    def headline(self) -> str:
        """The verdict in one sentence."""
        worn = sum(f.what == "wears" for f in self.findings)
        other = len({f.cell for f in self.findings if f.what != "wears"})
        told = f"{len(self.cells)} cell{'s' * (len(self.cells) != 1)} over {self.weeks} weeks"
        if not self.findings:
            return f"No joint wears and no cell drifts, of {told}."
        wear = f"{worn} joints wear" if worn != 1 else "1 joint wears"
        return f"{wear}, {other} cell{'s' * (other != 1)} changed otherwise, of {told}."

    def as_json(self) -> dict[str, Any]:
        """Return the content of fleet.json."""
        return asdict(self)
