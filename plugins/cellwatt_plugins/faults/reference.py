"""The healthy reference of an arm: a YAML file that a person can read and plot.

cellwatt_reference: 1         version of this format
robot: ur10e                  or null
arm: arm                      source of the encoders
power: supply.power           channel of the power, W
joints: 6
tasks:                        by intervals, for the paper's method
- name: task_1
  signature: 1+52 3-40 ...    moving joints with whole signed degrees
  variants:
  - speed: 1.0                relative to the fastest variant
    cycles: 7
    intervals:                those with a moving joint, in order
    - moving: [3]
      pose: [...]             rad, at its start; 0.2 m of a linear axis are 1 rad
      displacement: [...]     rad
      duration: 0.7           s
      rest: 0.25              s at rest before it
      cycles: 7
      power: {start: -0.2, step: 0.02, mean: [...], spread: [...]}          W over s from the onset
      position:
        3: {start: -0.2, step: 0.02, mean: [...], spread: [...]}            rad, moving joints only
power_model: ...              the arm's fitted parameters; without a description of the robot, its supply's alone
cycles:                       whole cycles
- task: task_1
  speed: 1.0
  cycles: 8
  step: 0.02                  s, between samples of power, spread and position
  moves: [[0.1, 0.9], ...]    s from the first point
  repeat: [...]               rad, standard deviation of the rest poses
  power: [...]                W
  spread: [...]               W
  position: {1: [...], ...}   rad, or m of a linear axis
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import yaml
from pydantic import ConfigDict, Field

from cellwatt.arrays import Float
from cellwatt.config import KeyPath, read_settings, reads_version
from cellwatt.errors import ModelError
from cellwatt.files import write_file
from cellwatt.frames import Layout
from cellwatt_plugins.faults.cycles.pattern import Pattern as CyclePattern
from cellwatt_plugins.robot.meter.model import Meter

VERSION = 1
LEAD = 0.2
"""Time by which a pattern begins before the onset, s …"""
TAIL = 0.1
"""… and by which it ends after the median duration, s."""

_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
_Rising = Annotated[float, Field(gt=0)]


class _Strict:
    """A part of the file: other keys than its own are refused."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")


@dataclass(frozen=True)
class Pattern(_Strict):
    """A quantity over time from the onset: at ``start`` + k ``step`` s, ``mean`` and ``spread`` (std) over cycles."""

    start: float
    step: _Rising
    mean: tuple[float, ...]
    spread: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.mean or len(self.mean) != len(self.spread):
            raise ValueError("mean and spread must have the same length, at least 1")

    @cached_property
    def time(self) -> Float:
        """Times of the points, s from the onset."""
        return np.asarray(self.start + self.step * np.arange(len(self.mean)), dtype=np.float64)

    @cached_property
    def values(self) -> Float:
        """``mean`` as an array."""
        return np.asarray(self.mean)

    def at(self, t: Float) -> Float:
        """The mean at times t of any shape, s; constant beyond both ends."""
        return np.asarray(np.interp(t, self.time, self.values), dtype=np.float64)


@dataclass(frozen=True)
class ReferenceInterval(_Strict):
    """One interval of a healthy cycle; the module's docstring describes its fields."""

    moving: tuple[int, ...]
    pose: tuple[float, ...]
    displacement: tuple[float, ...]
    duration: _Rising
    rest: float
    cycles: int
    power: Pattern
    position: Mapping[int, Pattern]


@dataclass(frozen=True)
class Variant(_Strict):
    """A task at one speed."""

    speed: float
    cycles: int
    intervals: tuple[ReferenceInterval, ...]


@dataclass(frozen=True)
class TaskReference(_Strict):
    """A task and its learned variants."""

    name: str
    signature: str
    variants: tuple[Variant, ...]


@dataclass(frozen=True)
class StoredJoint(_Strict):
    """Fitted parameters of a joint, at the joint side, units as in ``robot.yaml``, ``copper_loss`` in W/(Nm)²."""

    name: str
    rotor_inertia: float
    coulomb_friction: float
    viscous_friction: float
    copper_loss: float
    link: Annotated[tuple[float, ...], Field(min_length=10, max_length=10)]


@dataclass(frozen=True)
class StoredModel(_Strict):
    """The fitted arm: ``standby`` W, supply gains for power to the drives (``drive``) and back (``regenerate``).

    ``joints`` are empty without a description of the robot: they are fitted to the cycles whenever the file is read.
    """

    standby: float
    drive: float
    regenerate: float
    joints: tuple[StoredJoint, ...]
    meter: Meter | None = None


@dataclass(frozen=True)
class Reference(_Strict):
    """The healthy reference of one arm."""

    cellwatt_reference: Annotated[int, reads_version(VERSION, "learn it anew with `cellwatt reference`")]
    robot: str | None
    arm: str
    power: str
    joints: Annotated[int, Field(ge=1)]
    tasks: tuple[TaskReference, ...]
    power_model: StoredModel | None = None
    cycles: tuple[CyclePattern, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The joints' names in the robot's description; () if the reference was learned without one."""
        return () if self.power_model is None else tuple(joint.name for joint in self.power_model.joints)

    def source(self, layout: Layout, asked: str | None) -> str | None:
        """Source of the joints: ``asked``, else that of the reference; None if these frames have no such source."""
        return asked or (self.arm if any(channel.source == self.arm for channel in layout.channels) else None)


def save(reference: Reference, path: Path) -> None:
    """Write the YAML file. Raises ``CellwattError`` if it cannot be written."""
    content = asdict(reference)
    if reference.power_model is None:
        del content["power_model"], content["cycles"]
    write_file(path, yaml.dump(_plain(content), Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=118))


def load(path: Path) -> Reference:
    """Read the YAML file. Raises ``ModelError`` with file, line, column and the expected content."""
    if not path.exists():
        raise ModelError(f"{path}: no such file; learn one with `cellwatt reference`")
    return read_settings(path, Reference, _check, refusal=ModelError, computed=True)


def _check(reference: Reference) -> Iterator[tuple[KeyPath, str]]:
    """Check joint numbers and lengths of poses, which the types cannot express."""
    for t, task in enumerate(reference.tasks):
        for v, variant in enumerate(task.variants):
            for i, interval in enumerate(variant.intervals):
                place = ("tasks", t, "variants", v, "intervals", i)
                if {len(interval.pose), len(interval.displacement)} != {reference.joints}:
                    yield place, f"pose and displacement must have {reference.joints} values each"
                if not interval.moving or set(interval.moving) != set(interval.position):
                    yield place, "moving and position must name the same joints, at least one"
                if not all(1 <= joint <= reference.joints for joint in interval.moving):
                    yield (*place, "moving"), f"joints are numbered 1 to {reference.joints}"


def _plain(value: Any) -> Any:
    """Convert tuples to lists and matrices to columns by joint, and round numbers, for a short file."""
    if isinstance(value, np.ndarray):
        value = value.tolist() if value.ndim == 1 else dict(enumerate(value.T.tolist(), start=1))
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value
