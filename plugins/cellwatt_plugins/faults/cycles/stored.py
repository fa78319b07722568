"""The fitted arm in the reference file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field

from cellwatt_plugins.robot.meter.model import Meter

_STRICT = ConfigDict(extra="forbid")


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
