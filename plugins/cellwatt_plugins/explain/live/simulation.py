"""Simulation of a moving arm, one stretch of frames at a time. Imports Pinocchio and scipy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt.files import Place
from cellwatt_plugins.explain.fit.problem import title
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.explain.input.driven import drive_of
from cellwatt_plugins.explain.input.moved import moved
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.model import FittedTerm, Model, Prediction, Retuned, load_model, predict_states
from cellwatt_plugins.robot import Arm, load_robot
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.mjcf import is_mjcf
from cellwatt_plugins.robot.motion import QUICK_OCTAVES, exact, smooth
from cellwatt_plugins.robot.servo.filtered import compared_band
from cellwatt_plugins.robot.servo.law import Drive, Servo, earlier, servo_of
from cellwatt_plugins.robot.simulated import described, is_simulator

Driven = tuple[Float, Float]
"""Commands (N, n) rad of the servos, shifted as if each held for one sample, and torque (N, n) Nm by their law."""

PAST = 10.0
"""s of past from which effects with an internal state (hysteresis, a spring) are simulated."""
ALIKE = 0.05
"""Largest relative change of an effect's last second with much more known past, for a live simulation of it."""
LONG = 60.0
"""s of past used for that test."""


class Simulation:
    """A model of an arm on recorded motion.

    ``left_out`` names the effects of the model that cannot be simulated live: they depend on more of the past than a
    daemon knows (the start of the run, or when the joint was cold).
    """

    def __init__(self, model: Model, step: float, warm: bool, servo: Servo | None, hold: float | None) -> None:
        """``step`` is s from frame to frame; ``warm``: temperatures are recorded. Raises ``ConfigError``.

        ``hold`` is s for which a ``servo`` holds each command; ``step`` if None.
        """
        self._servo = servo
        self._late = 0.0 if hold is None else (hold - step) / 2
        followed = _followed(model, step, warm, servo is not None)
        self.left_out = tuple(title(t.term) for t, follows in zip(model.terms, followed, strict=True) if not follows)
        self.model = replace(model, terms=tuple(t for t, f in zip(model.terms, followed, strict=True) if f))
        self.known: set[tuple[str, int | None]] = {(t.term.effect.name, t.term.number) for t in model.terms}
        """Findings that are in the model, by the effect's name and 1-based joint."""
        if model.baseline.mounted is not None:
            self.known.add(("gravity_tilt", None))
        if model.baseline.recorded.coupling is not None:
            self.known |= {("joint_coupling", joint + 1) for joint in range(model.baseline.recorded.joints)}

    @property
    def lead(self) -> float:
        """s of past required before the first simulated frame."""
        return PAST if self.model.terms else 0.0

    def run(
        self, time: Float, position: Float, velocity: Float | None, temperature: Float | None, command: Float | None
    ) -> tuple[Prediction, Driven | None]:
        """Simulate recorded positions (N, n) at ``time`` (N,) s, evenly spaced; inaccurate near both ends.

        With a ``command`` (N, n), also return the torque of the servos' law; both torques are low-pass filtered for
        comparison.
        """
        recorded = Run("live", time, position, velocity, np.zeros_like(position), temperature=temperature)
        drive: Drive | None = None
        if self._servo is not None and command is not None:
            command = earlier(command, self._late, recorded.step)
            drive = drive_of(self._servo, position, command, recorded.step)
            recorded = replace(recorded, drive=drive)
        states = self.model.baseline.states(recorded, moved(recorded, QUICK_OCTAVES))
        predicted = predict_states(self.model, states)
        if drive is None or command is None:
            return predicted, None
        torque, law = (smooth(each, drive.step, compared_band(drive.step)) for each in (predicted.torque, drive.torque))
        return replace(predicted, torque=torque), (command, law)


def open_model(simulation: str, robot: Place | None, folder: Path, joints: int) -> Model:
    """The model that the settings name; ``folder`` is the base of a relative path.

    If ``robot`` is a simulator's file, its first ``joints`` are the arm. Raises ``ConfigError`` if there is no model,
    or if it cannot be read.
    """
    if simulation != "robot":
        return load_model(folder / simulation)
    if robot is None:
        raise ConfigError(
            "no description of the robot: set `robot` to a folder with robot.yaml and its URDF, in the cell or stage"
        )
    own = described(Path(robot), joints) if is_simulator(Path(robot)) else load_robot(robot)
    arm = Arm.of(own)
    return Model(Baseline(arm, arm), Retuned.nothing(arm.joints))


def servos(robot: Place | None, model: Model) -> tuple[Path, Servo]:
    """The MJCF with the law of an arm's servos, and the servos of its joints.

    Raises ``ConfigError`` if neither ``robot`` nor the model's own file is an MJCF with a servo for each joint.
    """
    files = [*([] if robot is None else [Path(robot)]), model.robot.urdf]
    for file in filter(is_mjcf, files):
        if servo := servo_of(file, model.robot.names):
            return file.absolute(), servo
    raise ConfigError(
        "an arm without torque and current is compared by the law of its servos: set `robot` to an MJCF with a "
        f"<position> actuator for each of {', '.join(model.robot.names)}"
    )


def _followed(model: Model, step: float, warm: bool, driven: bool) -> list[bool]:
    """For each term, whether it gives the same with ``PAST`` and with a much longer past, on a motion of all joints."""
    if not model.terms:
        return []
    arm = model.baseline.recorded
    long = _probe(arm, round((LONG + PAST + 1) / step), step, True)
    short = _probe(arm, round((PAST + 1) / step), step, warm)
    return [
        driven if fitted.term.effect.acts_on == "drive" else _alike(fitted, long, short, round(1 / step))
        for fitted in model.terms
    ]


def _probe(arm: Arm, samples: int, step: float, warm: bool) -> States:
    """A motion that ends at t = 0, whatever its length."""
    time: Float = step * np.arange(1.0 - samples, 1.0)
    turn: Float = 2 * np.pi * (0.2 + 0.05 * np.arange(arm.joints, dtype=np.float64))
    sine, cosine = np.sin(time[:, None] * turn), np.cos(time[:, None] * turn)
    motion = exact(0.3 + 0.5 * sine, 0.5 * turn * cosine, -0.5 * turn**2 * sine)
    temperature = np.full((samples, arm.joints), 35.0) if warm else None
    return States("probe", -1, time, motion, arm, temperature)


def _alike(fitted: FittedTerm, long: States, short: States, samples: int) -> bool:
    term = fitted.term
    whole, last = ((term.columns(states) @ fitted.coefficients)[-samples:] for states in (long, short))
    size = float(np.sqrt(np.mean(np.square(whole))))
    if size == 0 and term.effect.form.intermittent:
        return False
    return float(np.sqrt(np.mean(np.square(whole - last)))) <= ALIKE * size
