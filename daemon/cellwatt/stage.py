"""The contract between the daemon and a stage, which turns frames into results."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Generic, TypeVar

from cellwatt.frames import Frames, Layout
from cellwatt.results import Result
from cellwatt.section import Section


class StageSettings(Section):
    """Settings of one stage; every stage derives its own. Unknown keys are refused."""

    def files(self, folder: Path, robot: Path | None) -> Sequence[Path]:
        """Files that the stage reads: a reload restarts it if one of them was written again.

        By default, those that its settings name, relative to ``folder``, and the description of the cell's ``robot``.
        """
        named = [folder / value for value in dict(self).values() if isinstance(value, str | Path)]
        return named if robot is None else [*named, robot]


@dataclass(frozen=True, slots=True)
class CellInfo:
    """The cell as a stage sees it; relative paths in the settings start at ``folder``."""

    site: str
    cell: str
    robot: str | None
    folder: Path


S = TypeVar("S", bound=StageSettings)


class Stage(ABC, Generic[S]):
    """Turns frames into results; the same object serves the live daemon, replay and the offline commands.

    Created once the frames' layout is known; ``__init__`` raises ``ConfigError`` or ``ModelError`` if settings and
    layout do not fit, before any data flow. ``process`` is called in frame order, one call at a time.
    It must be a pure function of the frames since the stage was created, so that a replay gives the same results: no
    clock, no randomness without a seed.
    """

    Settings: ClassVar[type[StageSettings]]
    title: ClassVar[str]
    """One line for ``cellwatt drivers``."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Kinds of stages whose results this stage uses, e.g. ``("segment",)``; those stages run first."""

    def __init__(self, name: str, settings: S, layout: Layout, cell: CellInfo) -> None:
        self.name = name
        self.settings = settings
        self.layout = layout
        self.cell = cell

    @abstractmethod
    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """Return the results that this block completes. ``upstream``: results of the needed stages for this block."""

    def close(self) -> Sequence[Result]:
        """Return the results that the end of the data completes (e.g. the interval in progress)."""
        return ()
