"""Differences between two settings of a cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cellwatt.config import CellConfig
from cellwatt.errors import CellwattError


@dataclass(frozen=True, slots=True)
class Change:
    """Names of the sources, outlets and stages that were added, removed or changed.

    ``frames``: frames and stages restart. ``units``: values are shown in other units.
    """

    sources: Sequence[str]
    outlets: Sequence[str]
    stages: Sequence[str]
    frames: bool
    units: bool

    @classmethod
    def between(cls, old: CellConfig, new: CellConfig) -> Change:
        """Compare two settings of a cell.

        Raises ``CellwattError`` for changes that need a restart: site, cell, latency, record.
        """
        fixed = [k for k in ("site", "cell", "latency", "record") if getattr(old, k) != getattr(new, k)]
        if fixed:
            raise CellwattError(f"a change of {', '.join(fixed)} needs a restart; nothing was changed")
        sources, stages = _changed(old.sources, new.sources), _changed(old.stages, new.stages)
        frames = bool(sources or stages or old.frames != new.frames or old.robot != new.robot)
        return cls(sources, _changed(old.outlets, new.outlets), stages, frames, old.units != new.units)

    def __bool__(self) -> bool:
        return bool(self.frames or self.outlets or self.units)

    def __str__(self) -> str:
        if not self:
            return "nothing changed"
        changed = [f"{kind} {name}" for kind in ("source", "outlet", "stage") for name in getattr(self, f"{kind}s")]
        changed += ["units"] * self.units
        return "reloaded: " + (", ".join(changed) or "frames")


def _changed(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Names that were added, removed or whose values differ."""
    return [n for n in dict.fromkeys([*old, *new]) if old.get(n) != new.get(n)]
