"""Effect: one kind of physics with its columns, parameters and confusions, and the experiments that separate these."""

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
"""Nonlinear parameters of an effect, e.g. a velocity or a time constant."""
Names = tuple[tuple[str, str], ...]
"""Names of parameters, with their units."""
Plausible = tuple[Callable[[Float], float], float, float]
"""A number computed from the coefficients (m,), and its physically possible minimum and maximum."""
UNIT_SPREAD = 0.05
"""Prior standard deviation of the coefficient of an effect that is simulated to scale; its mean is 1."""
WIDE = 10.0
"""Factor on the prior of effects that descriptions have a number for: friction is most of some joints' torque."""
INHERITED = 0.01
"""Relative uncertainty of a parameter that no data reduce: links, friction, sampling are known to a few per cent."""


@dataclass(frozen=True)
class Parameter:
    """A number of the model with its standard deviation."""

    value: float
    std: float
    unit: str

    def __format__(self, spec: str) -> str:
        """The value in the format ``spec``, or, without one, with its uncertainty, e.g. ``4.1 ± 0.2 Nm``."""
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
    of_motor: ClassVar[bool] = False
    """True if it follows the turns of the joint's motor, which another joint may turn too."""
    depends_on: ClassVar[DependsOn] = "motion"
    nominal: ClassVar[str] = ""
    """The parameter of the description that it corrects: if that is not 0, it is mistuned rather than missing."""
    form: ClassVar[Form] = Form()
    acceptance: ClassVar[Acceptance] = Acceptance()
    relations: ClassVar[Relations] = Relations()
    uncertainty: ClassVar[Uncertainty] = Uncertainty()
    confusions: ClassVar[tuple[Confusion, ...]] = ()
    tried: ClassVar[Sequence[Shape]] = ((),)
    """Shapes to try, if they do not depend on the recordings."""
    refined: ClassVar[Sequence[tuple[float, float]]] = ()
    """Bounds of each shape parameter in its refinement, as factors on the shape that was tried, if that is all."""
    coefficients_are: ClassVar[Names] = ()
    shape_is: ClassVar[Names] = ()
    """Names of its first coefficients, and of its shape, as parameters; a number without a name is not reported."""
    scaled_is: ClassVar[Names] = ()
    """Name of the first shape parameter times the first coefficient; see ``Estimate.scaled``."""
    plausible: ClassVar[Plausible | None] = None
    """Limits for an effect that could otherwise stand for anything."""
    sentence: ClassVar[str] = ""
    """One plain sentence with ``{who}`` (``{joint}`` inside it) and parameters, as ``{force}`` or ``{speed:.2g}``."""

    @property
    def place(self) -> Place:
        """Where it acts: a joint, the whole robot, or the supply."""
        if self.acts_on == "supply":
            return "supply"
        return "robot" if self.whole_arm else "joint"

    @property
    def by_motion_alone(self) -> bool:
        """True if its columns and shapes do not depend on the fit."""
        return self.depends_on == "motion"

    @property
    def mechanical(self) -> bool:
        """True if it is part of the torque that moves the arm, not of its measurement or of a servo's law."""
        return self.acts_on not in ("reading", "drive")

    @property
    def usual(self) -> bool:
        """True for effects of most arms: friction of any law, and effects that descriptions have a number for."""
        return self.acceptance.usual or self.acts_on == "friction" or bool(self.nominal)

    def described(self, robot: RobotDescription, joint: int | None) -> float:
        """Its value in the description, 0 if that has none (0-based joint)."""
        if not self.nominal:
            return 0.0
        return float(getattr(robot if joint is None else robot.joints[joint], self.nominal))

    def sensible(self, coefficients: Float, shape: Shape, robot: RobotDescription, joint: int | None) -> bool:
        """True if coefficients (m,) are this effect, not a plainer one that looks the same (0-based joint)."""
        if self.plausible is None:
            return True
        number, low, high = self.plausible
        return low <= number(coefficients) <= high

    def closed(self, shape: Shape) -> bool:
        """True if a shape, refined without this condition, is one that a real arm can have."""
        return True

    def possible(self, robot: RobotDescription, joint: int | None) -> bool:
        """True if the simulation can lack it (0-based joint)."""
        return True

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        """Shapes to try, given each run's states and residual, (N, C) each."""
        return self.tried

    def reshaped(self, runs: Sequence[States], joint: int | None, course: Sequence[Float], own: Float) -> Shape | None:
        """The shape for known coefficients ``own`` (m,); ``course`` (N, C): each run's residual with this term removed.

        None if the effect's shape does not depend on its coefficients.
        """
        return None

    @abstractmethod
    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        """Contribution of one unit of each coefficient: (N, m) for a joint or the supply, (N, n, m) for the robot."""

    def acting(self, run: States, joint: int | None, shape: Shape) -> Float:
        """``columns`` as they act on the arm: (N, n, m) if they are of a motor that loads several joints."""
        if not (self.of_motor and run.arm.coupled(joint)):
            return self.columns(run, joint, shape)
        assert run.arm.coupling is not None
        return self.columns(run.motors, joint, shape)[:, None, :] * run.arm.coupling[joint][:, None]

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        """True if these recordings resolve the shape, so that it is not an artefact of their sampling."""
        return True

    def fuller(self, runs: Sequence[States], joint: int | None, shape: Shape) -> Sequence[Shape]:
        """Shapes that contain this one as a special case, tried once this one is found."""
        return []

    def unlike(self, runs: Sequence[States], joint: int | None, shape: Shape) -> Sequence[Shape]:
        """Shapes so different from this one that they must fit clearly worse, if this one is right."""
        return []

    def grid(self, run: States, joint: int | None, shapes: Sequence[Shape]) -> Sequence[Float]:
        """Columns of several shapes; simulated effects compute all shapes at once."""
        return [self.acting(run, joint, shape) for shape in shapes]

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        """Prior of the coefficients: each column may contribute about ``size`` (C,) in the unit of its channel.

        Effects that descriptions have a number for may contribute ``WIDE`` times as much.
        """
        if self.form.to_scale:
            return Prior.spread(np.full(columns.shape[-1], UNIT_SPREAD), 1.0)
        if columns.ndim == 3:
            strength = np.sqrt(np.max(np.mean(np.square(columns), axis=0) / np.square(size)[:, None], axis=0))
        else:
            strength = np.sqrt(np.mean(np.square(columns), axis=0)) / size[joint or 0]
        return Prior.spread((WIDE if self.nominal else 1.0) / np.maximum(strength, 1e-9))

    def charge(self, runs: Sequence[States], shape: Shape) -> float:
        """Penalty on the evidence in nats: logarithm of the number of places and times that this shape was chosen
        from."""
        return 0.0

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        """Lowest and highest value of each shape parameter, for its refinement; none if it is not refined."""
        return [(low * value, high * value) for value, (low, high) in zip(shape, self.refined, strict=False)]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        """Physical parameters with units."""
        found = {name: estimate.coefficient(i, unit) for i, (name, unit) in enumerate(self.coefficients_are)}
        found |= {name: estimate.shaped(i, unit) for i, (name, unit) in enumerate(self.shape_is) if name}
        return found | {name: estimate.scaled(unit) for name, unit in self.scaled_is}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        """One plain sentence; ``who`` names the place, e.g. ``Joint 2``."""
        return self.sentence.format(who=who, joint=who.lower(), **parameters)
