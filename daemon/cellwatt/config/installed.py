"""Installed drivers, stages and outlets, including those that cannot be loaded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel

from cellwatt.registry import available, load

PartKind = Literal["driver", "stage", "outlet"]
PART_KINDS: tuple[PartKind, ...] = ("driver", "stage", "outlet")


@dataclass(frozen=True, slots=True)
class Installed:
    """One driver, stage or outlet. ``found`` is its class, or ``None`` if it cannot be loaded; ``error``: why not."""

    kind: PartKind
    name: str
    package: str
    version: str
    found: type[Any] | None
    error: str = ""

    @property
    def title(self) -> str:
        """One-line description, or the reason why it cannot be loaded."""
        return self.error or str(getattr(self.found, "title", ""))

    @property
    def settings(self) -> type[BaseModel] | None:
        """Its settings class."""
        found: type[BaseModel] | None = getattr(self.found, "Settings", None)
        return found


def installed(*kinds: PartKind) -> list[Installed]:
    """All installed drivers, stages or outlets of ``kinds`` (default: all kinds), by kind and name."""
    return [_part(kind, name) for kind in kinds or PART_KINDS for name in available(f"cellwatt.{kind}s")]


def _part(kind: PartKind, name: str) -> Installed:
    group = f"cellwatt.{kind}s"
    distribution = available(group)[name].dist
    package = distribution.name if distribution is not None else ""
    version = distribution.version if distribution is not None else ""
    try:
        return Installed(kind, name, package, version, load(group, name))
    except Exception as error:  # any exception of a foreign package: the list must still be printed
        return Installed(kind, name, package, version, None, f"cannot be loaded: {' '.join(str(error).split())}")
