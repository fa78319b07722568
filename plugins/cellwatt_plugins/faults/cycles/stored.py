"""Whole cycles and the fitted arm in the reference file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field

from cellwatt_plugins.robot.meter import Meter

_STRICT = ConfigDict(extra="forbid")
_Rising = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class StoredJoint:
    """A joint as its healthy power has it; joint side, units as in ``robot.yaml``, ``copper_loss`` in W/(Nm)²."""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT

    name: str
    rotor_inertia: float
    coulomb_friction: float
    viscous_friction: float
    copper_loss: float
    link: Annotated[tuple[float, ...], Field(min_length=10, max_length=10)]


@dataclass(frozen=True)
class StoredModel:
    """The fitted arm: ``standby`` W, gains of the supply while drives take and give power."""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT

    standby: float
    drive: float
    regenerate: float
    joints: tuple[StoredJoint, ...]
    meter: Meter | None = None


@dataclass(frozen=True)
class StoredCycle:
    """One task at one speed: see ``Pattern``; ``position`` by joint number."""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT

    task: str
    speed: float
    cycles: Annotated[int, Field(ge=1)]
    step: _Rising
    moves: Annotated[tuple[tuple[float, float], ...], Field(min_length=1)]
    repeat: tuple[float, ...]
    power: tuple[float, ...]
    spread: tuple[float, ...]
    position: Mapping[int, tuple[float, ...]]

    def __post_init__(self) -> None:
        lengths = {len(self.power), len(self.spread), *map(len, self.position.values())}
        if len(lengths) != 1 or len(self.power) < 2:
            raise ValueError("power, spread and every position must have the same length, at least 2")
        if sorted(self.position) != list(range(1, len(self.repeat) + 1)):
            raise ValueError("position and repeat must have every joint")
        edges = [edge for move in self.moves for edge in move]
        if sorted(edges) != edges or edges[0] < 0 or edges[-1] > self.step * len(self.power):
            raise ValueError("moves must follow each other within the cycle")
