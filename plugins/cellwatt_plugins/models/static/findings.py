"""Findings about an arm that its CAD model lacks: in words, with figures and their standard deviations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.models.static.basis import PER_GRAVITY, Basis
from cellwatt_plugins.models.static.effects import Group
from cellwatt_plugins.models.static.identify import HeldArm, Identified
from cellwatt_plugins.robot.effects.load.gravity_tilt import level

_CLEAR: Final = 3.0
"""Standard deviations below which no figure is reported: of forty figures, two would exceed two by chance."""
_DETERMINED: Final = 0.5  # share of the prior standard deviation: the data have halved the uncertainty


@dataclass(frozen=True)
class Number:
    """A value and its standard deviation."""

    name: str
    value: float
    deviation: float
    unit: str

    def __str__(self) -> str:
        digits = max(0, min(4, 1 - int(np.floor(np.log10(max(self.deviation, 1e-4))))))
        return f"{self.value:.{digits}f} ± {self.deviation:.{digits}f} {self.unit}"


@dataclass(frozen=True)
class Finding:
    """One property of the arm that its CAD model lacks; joints count from 1.

    ``evidence``: evidence (natural log) of the finding; None for terms of every model.
    """

    kind: str
    joints: tuple[int, ...]
    statement: str
    figures: tuple[Number, ...]
    evidence: float | None


def findings(model: Identified, arm: HeldArm, basis: Basis) -> list[Finding]:
    """Findings of the model, on the ``basis`` of the poses that it was trained on."""
    found = [*_gravity(model, basis), *_masses(model)]
    for index, group in enumerate(model.effects.groups):
        if model.posterior.active[index] and group.kind in _FINDERS:
            found += _FINDERS[group.kind](_Selected(model, arm, basis, group, float(model.posterior.gain[index])))
    if model.leftover is not None:
        rest = np.std(model.leftover(basis.share), axis=0)
        which = ", ".join(f"joint {j + 1} {size:.2g} Nm" for j, size in enumerate(rest))
        text = f"Something else that depends on the pose: {which} (standard deviation over the poses)."
        found.append(Finding("left over", (), text, (), None))
    return found


@dataclass(frozen=True)
class _Selected:
    model: Identified
    arm: HeldArm
    basis: Basis
    group: Group
    evidence: float

    @property
    def part(self) -> slice:
        return self.model.effects.slices[self.group.name]

    @property
    def mean(self) -> Float:
        return self.model.posterior.mean[self.part]

    def figure(self, name: str, weights: Float, unit: str) -> Number:
        """A linear combination of the group's parameters."""
        covariance = self.model.posterior.covariance[self.part, self.part]
        return Number(name, float(weights @ self.mean), float(np.sqrt(weights @ covariance @ weights)), unit)

    def finding(self, text: str, *figures: Number) -> Finding:
        return Finding(self.group.kind, tuple(j + 1 for j in self.group.joints), text, figures, self.evidence)

    def pull(self, joint: int) -> tuple[Number, int]:
        """The group's strongest torque at a joint in any of the poses, and the index of that pose (from 0)."""
        slope = self.model.effects.load(self.basis, self.model.posterior.mean)[1][:, joint, self.part]
        pose = int(np.argmax(np.abs(slope @ self.mean)))
        return self.figure(f"torque of joint {joint + 1}", slope[pose], "Nm"), pose


def _gravity(model: Identified, basis: Basis) -> Iterator[Finding]:
    """Gravity about each joint in its heaviest pose: the total of the masses beyond it, however they are
    distributed."""
    effects, posterior = model.effects, model.posterior
    links = slice(0, PER_GRAVITY * effects.joints)
    for joint in range(effects.joints):
        thought = basis.vertical[:, joint] @ effects.cad
        pose = int(np.argmax(np.abs(thought)))
        row = basis.vertical[pose, joint]
        change = float(row @ posterior.mean[links])
        figure = Number(
            f"gravity of joint {joint + 1}",
            float(thought[pose]) + change,
            float(np.sqrt(row @ posterior.covariance[links, links] @ row)),
            "Nm",
        )
        if abs(change) > _CLEAR * figure.deviation and abs(thought[pose]) > 1e-6:
            text = (
                f"Joint {joint + 1} carries {figure} of gravity in pose {pose + 1}, the heaviest; "
                f"{thought[pose]:.2f} Nm in the CAD model."
            )
            yield Finding("gravity", (joint + 1,), text, (figure,), None)


def _masses(model: Identified) -> Iterator[Finding]:
    effects, posterior = model.effects, model.posterior
    names = ("mass", "moment x", "moment y", "moment z")
    for i in range(effects.joints):
        part = effects.slices[f"link {i + 1}"]
        mean, deviation = posterior.mean[part], posterior.deviation[part]
        clear = (deviation < _DETERMINED * effects.scale[part]) & (np.abs(mean) > _CLEAR * deviation)
        figures = [
            Number(names[k], float(effects.cad[part][k] + mean[k]), float(deviation[k]), "kg" if k == 0 else "kg m")
            for k in np.flatnonzero(clear)
        ]
        if figures:
            by_name = dict(zip(names, effects.cad[part], strict=True))
            words = ", ".join(f"{f.name} {f} (CAD {by_name[f.name]:.2f})" for f in figures)
            yield Finding("link", (i + 1,), f"Link {i + 1}: {words}.", tuple(figures), None)


def _friction(selected: _Selected) -> list[Finding]:
    figure = selected.figure("friction", np.ones(1), "Nm")
    joint = selected.group.joints[0] + 1
    text = f"Joint {joint}: friction holds {figure}, for or against, by the direction of approach."
    return [selected.finding(text, figure)]


def _spring(selected: _Selected) -> list[Finding]:
    joint = selected.group.joints[0]
    half, middle = selected.model.effects.half[joint], selected.arm.limits[joint].mean()
    stiffness = selected.figure("stiffness", np.array([0.0, 1.0 / half]), "Nm/rad")
    middle_torque = selected.figure(f"torque at {middle:.2f} rad", np.array([1.0, 0.0]), "Nm")
    text = (
        f"A spring, hose or balancer at joint {joint + 1}: {stiffness}, and {middle_torque} in the middle of the "
        f"range ({middle:.2f} rad)."
    )
    return [selected.finding(text, stiffness, middle_torque)]


def _bent_spring(selected: _Selected) -> list[Finding]:
    joint = selected.group.joints[0]
    figure, pose = selected.pull(joint)
    text = f"Its torque at joint {joint + 1} is not linear: it deviates by up to {figure} (in pose {pose + 1})."
    return [selected.finding(text, figure)]


def _hose(selected: _Selected) -> list[Finding]:
    a, b = selected.group.joints
    pulls = [selected.pull(joint) for joint in (a, b)]
    words = " and ".join(f"{figure} at joint {j + 1}" for (figure, _), j in zip(pulls, (a, b), strict=True))
    kind = "A hose or cable" if selected.group.kind == "hose" else "Its bends"
    text = f"{kind} over joints {a + 1} and {b + 1}: up to {words}."
    return [selected.finding(text, *(figure for figure, _ in pulls))]


def _payload(selected: _Selected) -> list[Finding]:
    figures = [selected.figure(axis, weights, "m") for axis, weights in zip("xyz", np.eye(3), strict=True)]
    words = ", ".join(f"{f.name} {f}" for f in figures)
    return [selected.finding(f"Payloads have their centre of mass at {words} from the last joint.", *figures)]


def _each(selected: _Selected) -> list[Finding]:
    """The figures that clearly differ from 0, in one sentence."""
    text, factor, unit = _EACH[selected.group.kind]
    names = [f"joint {j + 1}" for j in range(selected.model.effects.joints)]
    if selected.group.kind == "tilt":
        names = [f"down along {'xyz'[axis]}" for axis in level(selected.arm.arm.body.gravity_field)]
    common = np.ones((len(names), len(selected.mean) - len(names)))
    weights = factor * np.column_stack([common, np.eye(len(names))])
    figures = [selected.figure(name, own, unit) for name, own in zip(names, weights, strict=True)]
    clear = [f for f in figures if abs(f.value) > _CLEAR * f.deviation]
    words = ", ".join(f"{f.name} {f}" for f in clear)
    return [selected.finding(f"{text}: {words}.", *clear)] if clear else []


_EACH: Final = {
    "load friction": ("Friction also holds a share of the load", 100.0, "%"),
    "gain": ("Torques are measured high (low if negative), compared with gravity at the other joints", 100.0, "%"),
    "zero": ("Zero positions are wrong", float(np.degrees(1.0)), "°"),
    "tilt": ("The base is not level", float(np.degrees(1.0)), "°"),
}
"""Groups with one figure per joint, or per level axis, after common ones: words, factor to the unit, unit."""
_FINDERS: Final = {
    "friction": _friction,
    "spring": _spring,
    "bent spring": _bent_spring,
    "hose": _hose,
    "bent hose": _hose,
    "payload": _payload,
    **dict.fromkeys(_EACH, _each),
}
