"""Time that the work takes with any number of workers, from the parts of one serial run and what a scheduler costs.

T(w) = start + serial + anew + Σ stages (max(longest, work / w) + [w > 1] · longest / 2) + tasks · task + bytes · byte

Tasks and bytes pass through one process, the command's, so they do not shrink with w. Half a longest task is what a
stage waits for on average at its end while others have nothing to do. ``anew`` is what each worker makes for itself
(the problem of a search, the fit of its present terms): what the run with one worker took beyond all else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from scaling.overheads import Overheads


@dataclass(frozen=True)
class Law:
    """The parts, s."""

    serial: float
    work: float
    """In the stages that are spread."""
    stages: tuple[tuple[float, float], ...]
    """Work and longest task of each."""
    tasks: int
    sent: int
    """Bytes to and from the workers, what all share once a stage."""
    costs: Overheads
    anew: float = 0.0

    @classmethod
    def of(cls, inside: Mapping[str, Any], costs: Overheads) -> Law:
        """From what ``inside`` and ``overheads`` have measured."""
        stages = inside["stages"]
        work = sum(each["seconds"] for each in stages)
        return cls(
            inside["seconds"] - work,
            work,
            tuple((each["seconds"], each["longest"]) for each in stages),
            sum(each["tasks"] for each in stages),
            sum(each["bytes"] + each["shared"] for each in stages),
            costs,
        )

    def beside(self, serial: float, one: float) -> Law:
        """The same where the command took ``serial`` s by itself and ``one`` s with one worker.

        What it took by itself beyond the parts is its own start.
        """
        plain = replace(self, anew=0.0, serial=self.serial + max(0.0, serial - self.seconds(None)))
        return replace(plain, anew=max(0.0, one - plain.seconds(1)))

    def seconds(self, workers: int | None) -> float:
        """With so many workers; None: without a scheduler."""
        if workers is None:
            return self.serial + self.work
        spread = sum(
            max(longest, work / workers) + (longest / 2 if workers > 1 else 0.0) for work, longest in self.stages
        )
        return (
            self.costs.start
            + self.serial
            + self.anew
            + spread
            + self.tasks * self.costs.task
            + self.sent * self.costs.byte
        )
