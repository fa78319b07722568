"""The augmented model: the nominal law with retuned parameters and the effects found; stored as ``model.yaml``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import yaml
from pydantic import AfterValidator, BaseModel

from cellwatt.arrays import Float
from cellwatt.config import KeyPath, read_settings, reads_version
from cellwatt.errors import ConfigError, ModelError
from cellwatt.files import write_file
from cellwatt_plugins.explain.fit.problem import Term, on_joints
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.robot import Arm, RobotDescription
from cellwatt_plugins.robot.body import PER_LINK, urdf_bytes
from cellwatt_plugins.robot.drive import copper_loss
from cellwatt_plugins.robot.effects import BY_NAME
from cellwatt_plugins.robot.effects.effect import Effect
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.servo import BY_NAME_IN_MOTION, IN_MOTION

FORMAT = 2

if TYPE_CHECKING:
    Array = Float
    Vector = Float
    Matrix = Float
else:  # of a file's numbers
    Array = Annotated[tuple[float, ...], AfterValidator(np.array)]
    Vector = Annotated[tuple[float, float, float], AfterValidator(np.array)]
    Matrix = Annotated[tuple[tuple[float, ...], ...], AfterValidator(np.array)]


@dataclass(frozen=True)
class FittedTerm:
    """An effect with its fitted coefficients."""

    term: Term
    coefficients: Float

    def course(self, states: States) -> Float:
        """Contribution of the term along a run: (N, n) Nm at the joints, or (N,) W for the supply."""
        term = self.term
        course = np.asarray(term.columns(states) @ self.coefficients)
        return course if term.effect.place == "supply" else on_joints(course, term.joint, states.q.shape[1])


@dataclass(frozen=True)
class Retuned:
    """Corrections of the nominal parameters of n joints."""

    inertial: Array
    """(10 n,), added to the links' parameters."""
    coulomb_friction: Array
    """(n,) Nm, added; the next two are added likewise."""
    viscous_friction: Array
    rotor_inertia: Array
    standby_power: float
    """W, added."""
    resistance: Array
    """(n,), relative correction of each winding's resistance: the resistance is multiplied by 1 plus this value."""

    @classmethod
    def nothing(cls, joints: int) -> Retuned:
        """Zero corrections: the nominal parameters unchanged."""
        zeros = np.zeros(joints)
        return cls(np.zeros(10 * joints), zeros, zeros, zeros, 0.0, zeros)


@dataclass(frozen=True)
class Prediction:
    """Prediction of a model for a motion."""

    time: Float
    """(N,) s."""
    torque: Float
    """(N, n) Nm as a measurement would show it."""
    power: Float
    """(N,) W."""


@dataclass(frozen=True)
class Model:
    """A robot with retuned parameters and the effects that its simulation lacked."""

    baseline: Baseline
    """The simulation's law, to which the model adds."""
    retuned: Retuned
    terms: tuple[FittedTerm, ...] = ()

    @property
    def robot(self) -> RobotDescription:
        """The robot with the friction, rotors, windings and standby power of the simulation."""
        return self.baseline.arm.description


def predict_states(model: Model, states: States) -> Prediction:
    """Torque and power that a model predicts along a motion."""
    mechanical = mechanical_torque(model, states)
    states = states.with_torque(mechanical)
    torque, power = mechanical.copy(), _supply(model, states)
    for fitted in model.terms:
        effect = fitted.term.effect
        if effect.place == "supply":
            power = power + fitted.course(states)
        elif effect.acts_on == "reading" or (effect.acts_on == "drive" and states.drive is not None):
            torque += fitted.course(states)
    return Prediction(states.time, torque, power)


def mechanical_torque(model: Model, states: States) -> Float:
    """Torque (N, n) Nm of the law and the mechanical effects, without effects on the measurement alone."""
    retuned = model.retuned
    turned = states.motors
    friction = retuned.coulomb_friction * turned.sign + retuned.viscous_friction * turned.qd
    motors = states.arm.of_motors(friction + retuned.rotor_inertia * turned.qdd)
    carried = states.regressor @ retuned.inertial
    for fitted in model.terms:
        if fitted.term.effect.acts_on == "links":
            carried += fitted.course(states)
    torque = states.nominal + carried + motors
    states = states.with_torque(states.torque, carried)
    for fitted in model.terms:
        if fitted.term.effect.acts_on not in ("links", "supply", "reading", "drive"):
            torque += fitted.course(states)
    return np.asarray(torque)


def _supply(model: Model, states: States) -> Float:
    """Supply power (N,) W of the simulation with retuned standby power and resistances."""
    copper = copper_loss(model.robot, states.torque) * model.retuned.resistance
    return np.asarray(states.nominal_power + model.retuned.standby_power + np.sum(copper, axis=1))


def save_model(model: Model, path: Path) -> None:
    """Write ``model.yaml`` and the URDF beside it. Raises ``CellwattError`` if they cannot be written."""
    urdf = path.with_suffix(".urdf")  # not robot.urdf, which may be the user's
    if urdf.resolve() != model.robot.urdf.resolve():
        write_file(urdf, urdf_bytes(model.robot.urdf, model.robot.names))
    robot = model.robot.model_dump(mode="json", exclude_none=True) | {"urdf": urdf.name}
    retuned = {name: np.asarray(value).tolist() for name, value in vars(model.retuned).items()}
    terms = [_term(fitted) for fitted in model.terms]
    content = {"format": FORMAT, "robot": robot, **_differences(model.baseline), "retuned": retuned, "effects": terms}
    write_file(path, yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120))


def _differences(base: Baseline) -> dict[str, Any]:
    """What the simulation has otherwise than the description, and the real arm than the simulation; see ``_File``."""
    arm, recorded = base.arm, base.recorded
    stated, simulated = arm.description.gravity, arm.body.gravity_field
    lead = recorded.description.friction_lead
    known: dict[str, Float | None] = {
        "links": arm.body.changed,
        "gravity": None if np.array_equal(simulated, stated) else simulated,
        "mount": None if base.mounted is None else recorded.body.gravity_field,
        "coupling": recorded.coupling,
        "lead": None if lead == arm.description.friction_lead else np.array(lead),
    }
    return {name: value.tolist() for name, value in known.items() if value is not None}


def _term(fitted: FittedTerm) -> dict[str, Any]:
    effect, shape = fitted.term.effect, [float(x) for x in fitted.term.shape]
    numbers = {"shape": shape, "coefficients": fitted.coefficients.tolist()}
    content = {"effect": effect.name, "joint": fitted.term.number, **numbers}
    return content | ({"in_motion": True} if effect in IN_MOTION and BY_NAME.get(effect.name) is not effect else {})


class _Effect(BaseModel):
    effect: str
    joint: int | None
    shape: tuple[float, ...]
    coefficients: Array
    in_motion: bool = False
    """True for an effect found from motion without torque, under a name that an effect on torque may have, too."""

    @property
    def known(self) -> Mapping[str, Effect]:
        """The effects to which the name refers."""
        return BY_NAME_IN_MOTION if self.in_motion else BY_NAME


class _File(BaseModel):
    """Content of ``model.yaml``."""

    format: Annotated[int, reads_version(FORMAT, "run `cellwatt explain` again")]
    robot: RobotDescription
    links: Array | None = None
    """(10 n,) inertial parameters, where the simulation's differ from the URDF's."""
    gravity: Vector | None = None
    """m/s² in the base's frame, where the simulation's mount differs from the URDF's."""
    mount: Vector | None = None
    """m/s²: gravity in the base's frame for the real arm, where its mount differs from the simulation's."""
    lead: float | None = None
    """s by which the arm's friction reverses early, where it differs from the simulation's."""
    coupling: Matrix | None = None
    """Turns (n, n) of each motor per turn of each joint, where motors of the real arm turn with several joints."""
    retuned: Retuned
    effects: tuple[_Effect, ...]


def load_model(path: Path) -> Model:
    """Read ``model.yaml`` (or the folder that holds it). Raises ``ConfigError`` with file and key."""
    file = path / "model.yaml" if path.is_dir() else path
    try:
        found = read_settings(file, _File, _known, refusal=ModelError, computed=True)
    except ModelError as error:
        raise ConfigError(f"{error}; models are written by `cellwatt explain`") from error
    arm = Arm.of(found.robot.model_copy(update={"urdf": file.parent / found.robot.urdf}))
    arm = arm if found.links is None else arm.with_parameters(found.links)
    arm = arm if found.gravity is None else arm.with_gravity(found.gravity)
    recorded = arm if found.mount is None else arm.with_gravity(found.mount)
    recorded = recorded if found.coupling is None else recorded.with_coupling(found.coupling)
    recorded = recorded if found.lead is None else recorded.with_friction_lead(found.lead)
    terms = tuple(
        FittedTerm(Term(each.known[each.effect], each.joint and each.joint - 1, each.shape), each.coefficients)
        for each in found.effects
    )
    return Model(Baseline(arm, recorded), found.retuned, terms)


def _known(file: _File) -> Iterator[tuple[KeyPath, str]]:
    joints = len(file.robot.joints)
    shapes = {"links": (PER_LINK * joints,), "inertial": (PER_LINK * joints,), "coupling": (joints, joints)}
    retuned = ((("retuned", name), values) for name, values in vars(file.retuned).items())
    for key, values in ((("links",), file.links), (("coupling",), file.coupling), *retuned):
        shape = shapes.get(key[-1], (joints,))
        if isinstance(values, np.ndarray) and values.shape != shape:
            yield key, f"found the shape {values.shape}, expected {shape}"
    for i, each in enumerate(file.effects):
        if each.effect not in each.known:
            yield ("effects", i, "effect"), f"effect {each.effect!r} is not known to this version"
        if each.joint is not None and not 1 <= each.joint <= len(file.robot.joints):
            yield ("effects", i, "joint"), f"the robot has the joints 1 to {len(file.robot.joints)}"
