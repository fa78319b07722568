"""Effect: a physical kind with its columns, parameters, confusions and the experiment that separates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import (
    Acceptance,
    ActsOn,
    Confusion,
    DependsOn,
    Form,
    Place,
    Relations,
    Uncertainty,
)
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.regression import Prior

Shape = tuple[float, ...]
"""Parameters of an effect that are not linear, e.g. a velocity or a time constant."""
Names = tuple[tuple[str, str], ...]
"""Names of parameters, with their units."""
Plausible = tuple[Callable[[Float], float], float, float]
"""A number of the coefficients (m,), and the least and the greatest that it can physically be."""
UNIT_SPREAD = 0.05
"""Standard deviation from 1 of the coefficient of an effect that is simulated to scale."""
WIDE = 10.0
"""Times the size that counts as considerable, of what arms have: in some joints friction is most of the torque."""
INHERITED = 0.01
"""Share of a parameter that no data make certain: links, friction and sampling are known to a few per cent each."""


@dataclass(frozen=True)
class Parameter:
    """A number of the model with its standard deviation."""

    value: float
    std: float
    unit: str

    def __format__(self, spec: str) -> str:
        """The value as ``spec`` says, else with its uncertainty as people write it, e.g. ``4.1 ± 0.2 Nm``."""
        unit = self.unit.replace("N*m", "Nm").replace("*", "·")
        if spec or not np.isfinite(self.std) or self.std <= 0:
            return format(self.value, spec) if spec else f"{self.value:.3g} {unit}".rstrip()
        size = int(np.floor(np.log10(self.std)))
        digits = max(0, (self.std < 10**size * 2) - size)
        return f"{self.value:.{digits}f} ± {self.std:.{digits}f} {unit}".rstrip()


@dataclass(frozen=True)
class Estimate:
    """Estimated numbers of a term: coefficients (m,) and shape (k,), with the covariance (m + k, m + k) of both."""

    coefficients: Float
    shape: Float
    covariance: Float

    def coefficient(self, i: int, unit: str, sign: float = 1.0) -> Parameter:
        """A coefficient as a parameter."""
        return Parameter(float(sign * self.coefficients[i]), float(np.sqrt(self.covariance[i, i])), unit)

    def shaped(self, i: int, unit: str) -> Parameter:
        """A shape parameter."""
        k = len(self.coefficients) + i
        return Parameter(float(self.shape[i]), float(np.sqrt(self.covariance[k, k])), unit)

    def scaled(self, unit: str) -> Parameter:
        """The first shape parameter times the first coefficient, where columns are nearly linear in that shape."""
        k, factor, value = len(self.coefficients), self.coefficients[0], self.shape[0]
        slope = np.zeros(len(self.covariance))
        slope[0], slope[k] = value, factor
        return Parameter(float(factor * value), float(np.sqrt(slope @ self.covariance @ slope)), unit)


class Effect(ABC):
    """One kind of physics that a simulation may lack."""

    name: ClassVar[str]
    acts_on: ClassVar[ActsOn] = "joint"
    whole_arm: ClassVar[bool] = False
    """One term for all joints, not one for each."""
    depends_on: ClassVar[DependsOn] = "motion"
    nominal: ClassVar[str] = ""
    """The parameter of the description that it stands for: where that is not 0, it is mistuned rather than missing."""
    form: ClassVar[Form] = Form()
    acceptance: ClassVar[Acceptance] = Acceptance()
    relations: ClassVar[Relations] = Relations()
    uncertainty: ClassVar[Uncertainty] = Uncertainty()
    confusions: ClassVar[tuple[Confusion, ...]] = ()
    tried: ClassVar[Sequence[Shape]] = ((),)
    """Shapes to try, where recordings have no say in them."""
    coefficients_are: ClassVar[Names] = ()
    shape_is: ClassVar[Names] = ()
    """Its first coefficients, and its shape, as parameters; a number without a name is not told."""
    plausible: ClassVar[Plausible | None] = None
    """Where it could otherwise stand for anything."""
    sentence: ClassVar[str] = ""
    """One plain sentence with ``{who}`` (``{joint}`` inside it) and parameters, as ``{force}`` or ``{speed:.2g}``."""

    @property
    def place(self) -> Place:
        """Place: a joint, the whole robot, or the supply."""
        if self.acts_on == "supply":
            return "supply"
        return "robot" if self.whole_arm else "joint"

    @property
    def by_motion_alone(self) -> bool:
        """True if its columns and shapes stay as they are whatever is fitted."""
        return self.depends_on == "motion"

    @property
    def mechanical(self) -> bool:
        """True if it is part of the torque that moves the arm, not of how that is told."""
        return self.acts_on not in ("reading", "drive")

    @property
    def usual(self) -> bool:
        """True for what most arms have: friction of any law, and what descriptions have a number for."""
        return self.acceptance.usual or self.acts_on == "friction" or bool(self.nominal)

    def described(self, robot: RobotDescription, joint: int | None) -> float:
        """The value that the description has for it, 0 where it has none (0-based joint)."""
        if not self.nominal:
            return 0.0
        return float(getattr(robot if joint is None else robot.joints[joint], self.nominal))

    def sensible(self, coefficients: Float, shape: Shape, robot: RobotDescription, joint: int | None) -> bool:
        """True if coefficients (m,) are this effect, not a plainer fact that looks the same (0-based joint)."""
        if self.plausible is None:
            return True
        number, low, high = self.plausible
        return low <= number(coefficients) <= high

    def possible(self, robot: RobotDescription, joint: int | None) -> bool:
        """True if the simulation lacks it at all (0-based joint)."""
        return True

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        """Shapes to try, given each run's states and what is left unexplained there, (N, C) each."""
        return self.tried

    def reshaped(self, runs: Sequence[States], joint: int | None, course: Sequence[Float], own: Float) -> Shape | None:
        """The shape anew, now that coefficients ``own`` (m,) are known; ``course`` (N, C): what is left without it.

        None where an effect's shape does not depend on them.
        """
        return None

    @abstractmethod
    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        """Contribution of one unit of each coefficient: (N, m) for a joint or the supply, (N, n, m) for the robot."""

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        """True if these recordings can show such a shape, not only what their sampling makes of motion."""
        return True

    def fuller(self, runs: Sequence[States], joint: int | None, shape: Shape) -> Sequence[Shape]:
        """Shapes that this one is a part of, tried once it is found."""
        return []

    def unlike(self, runs: Sequence[States], joint: int | None, shape: Shape) -> Sequence[Shape]:
        """Shapes so unlike this one that they must fit clearly worse, if it is this one."""
        return []

    def grid(self, run: States, joint: int | None, shapes: Sequence[Shape]) -> Sequence[Float]:
        """Columns of several shapes; effects that are simulated do all at once."""
        return [self.columns(run, joint, shape) for shape in shapes]

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        """Prior of the coefficients: each column may add about ``size`` (C,) of its channel's unit.

        What descriptions have a number for may be ``WIDE`` times as much.
        """
        if self.form.to_scale:
            return Prior.spread(np.full(columns.shape[-1], UNIT_SPREAD), 1.0)
        if columns.ndim == 3:
            strength = np.sqrt(np.max(np.mean(np.square(columns), axis=0) / np.square(size)[:, None], axis=0))
        else:
            strength = np.sqrt(np.mean(np.square(columns), axis=0)) / size[joint or 0]
        return Prior.spread((WIDE if self.nominal else 1.0) / np.maximum(strength, 1e-9))

    def charge(self, runs: Sequence[States], shape: Shape) -> float:
        """nats that the evidence is charged: logarithm of the places and times that this shape was picked from."""
        return 0.0

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        """Least and greatest value of each shape parameter, for its refinement; () where it is not refined."""
        return ()

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        """Physical parameters with units."""
        found = {name: estimate.coefficient(i, unit) for i, (name, unit) in enumerate(self.coefficients_are)}
        return found | {name: estimate.shaped(i, unit) for i, (name, unit) in enumerate(self.shape_is) if name}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        """One plain sentence; ``who`` names the place, e.g. ``Joint 2``."""
        return self.sentence.format(who=who, joint=who.lower(), **parameters)
