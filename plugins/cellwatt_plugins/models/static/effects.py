"""Torques of a still arm: gravity, springs, hoses and friction, by their parameters, with their derivatives.

    τ = (1 + γ) ∘ G(q + δ; θ, tilt, payload) + springs(q) + hoses(q) + d ∘ (f + μ ∘ |load|)

G is gravity (eq. 2 of the paper), linear in the masses and first moments θ of the links. d is the direction in which a
joint came to the pose: friction holds a share of the load, so that the motor needs more or less torque (Coulomb's f,
and a share μ of the load). Springs and hoses are derivatives of energies that are polynomials (Legendre's) of one
joint's angle, or of two joints' angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.models.static.basis import PER_GRAVITY, Basis
from cellwatt_plugins.robot.priors import body_prior, link_prior

GAIN: Final = 0.05
"""Prior standard deviation of torque gains (all here are prior standard deviations)."""
TILT: Final = 0.01
"""rad, tilt of the base."""
ZERO: Final = 0.003
"""rad, error of each joint's zero."""
FRICTION: Final = 0.015
"""Share of the rated torque."""
LOAD_FRICTION: Final = 0.05
"""Share of the load."""
PAYLOAD: Final = 0.15
"""m, distance of a payload's centre of mass from the flange."""
SPRING: Final = 0.05
"""Share of the rated torque, at a joint's limit."""
ADDED: Final = 0.01
"""Share of the arm's own mass, added to any link beside its tolerance (hoses, cables, tools)."""
PLAIN: Final = 3
"""Highest degree of the group of a hose's energy that is a linear spring; higher degrees are bent."""
BENT: Final = 7
"""Highest degree of a bent spring's or hose's energy."""
DECAY: Final = 0.5
"""Ratio of the prior standard deviation of each degree to that of the degree below."""


def degrees(low: int, high: int) -> tuple[tuple[int, int], ...]:
    """Degrees in the first and in the second angle of an energy over two joints; their sum is above low, up to high."""
    return tuple((a, total - a) for total in range(max(low + 1, 2), high + 1) for a in range(1, total))


@dataclass(frozen=True)
class Group:
    """Parameters that are selected together; ``scale`` (k,) is the prior standard deviation (σ) of each."""

    kind: str
    joints: tuple[int, ...]
    """Empty for all joints."""
    scale: Float

    @property
    def name(self) -> str:
        """``spring 2``, ``hose 3-4``; joints count from 1."""
        return f"{self.kind} {'-'.join(str(j + 1) for j in self.joints)}".rstrip()


@dataclass(frozen=True)
class Effects:
    """All parameters of an arm: ``cad`` (4n,) its gravity parameters, ``rated`` (n,) Nm, ``half`` ranges (n,) rad."""

    cad: Float
    rated: Float
    half: Float
    link: float
    """Tolerance of the links' parameters, as a share."""
    carries: bool = False
    """True if payloads differ between poses."""

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The groups in the order of their parameters."""
        return tuple(self._groups())

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Slice of each group's parameters."""
        ends = np.cumsum([len(group.scale) for group in self.groups])
        return {g.name: slice(int(e) - len(g.scale), int(e)) for g, e in zip(self.groups, ends, strict=True)}

    @cached_property
    def scale(self) -> Float:
        """Prior standard deviations (P,)."""
        return np.concatenate([group.scale for group in self.groups])

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.rated)

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Joints that a hose may span: neighbours, and joints with one between."""
        return tuple((a, b) for a, b in combinations(range(self.joints), 2) if b - a <= 2)

    def evaluate(self, basis: Basis, p: Float) -> tuple[Float, Float]:
        """Torques (N, n) Nm for parameters ``p`` (P,), and their derivatives (N, n, P)."""
        load, slope = self.load(basis, p)
        d, (_, mu) = basis.direction, self.friction_of(p)
        sign = np.sign(load)
        torque = load + d * self.friction(p, load)
        slope *= (1 + d * mu * sign)[:, :, None]
        for j in range(self.joints):
            slope[:, j, self.slices[f"friction {j + 1}"]] = d[:, j, None]
        common = self.slices["load friction"].start
        own = range(common + 1, common + 1 + self.joints)
        slope[:, :, common] = slope[:, range(self.joints), own] = d * np.abs(load)
        return torque, slope

    def friction(self, p: Float, load: Any) -> Any:
        """Share (N, n) Nm of a ``load`` (N, n) Nm, an array or a ``Tensor``, that friction can hold."""
        f, mu = self.friction_of(p)
        return f + mu * np.abs(load)

    def load(self, basis: Basis, p: Float) -> tuple[Float, Float]:
        """Load without friction: torques (N, n), and their derivatives (N, n, P)."""
        at, n = self.slices, self.joints
        slope = np.zeros((len(basis), n, len(self.scale)))
        theta = self.cad + np.concatenate([p[at[f"link {i + 1}"]] for i in range(n)])
        gain, tilt, zero = 1 + p[at["gain"]], p[at["tilt"]], p[at["zero"]]
        aside, turned = basis.sideways @ theta, basis.slopes @ theta
        gravity = basis.vertical @ theta + np.tensordot(tilt, aside, 1) + np.tensordot(zero, turned, 1)
        if self.carries:
            last = basis.vertical[:, :, -PER_GRAVITY:] * basis.payload[:, None, None]
            gravity = gravity + last[:, :, 0] + last[:, :, 1:] @ p[at["payload"]]
            slope[:, :, at["payload"]] = gain[:, None] * last[:, :, 1:]
        links = basis.vertical + np.tensordot(tilt, basis.sideways, 1) + np.tensordot(zero, basis.slopes, 1)
        slope[:, :, : PER_GRAVITY * n] = gain[:, None] * links
        slope[:, :, at["tilt"]] = gain[:, None] * np.moveaxis(aside, 0, -1)
        slope[:, :, at["zero"]] = gain[:, None] * np.moveaxis(turned, 0, -1)
        slope[:, range(n), at["gain"].start + np.arange(n)] = gravity
        self._springs(basis, slope)
        linear = self.linear
        return gain * gravity + slope[:, :, linear] @ p[linear], slope

    @cached_property
    def linear(self) -> slice:
        """Slice of the parameters of springs and hoses, in which the load is linear."""
        return slice(self.slices["spring 1"].start, self.slices["friction 1"].start)

    def _springs(self, basis: Basis, slope: Float) -> None:
        value, change = legendre(basis.share)
        for j in range(self.joints):
            slope[:, j, self.slices[f"spring {j + 1}"]] = value[:2, :, j].T
            slope[:, j, self.slices[f"bent spring {j + 1}"]] = value[2:BENT, :, j].T
        for a, b in self.pairs:
            for kind, terms in (("hose", degrees(0, PLAIN)), ("bent hose", degrees(PLAIN, BENT))):
                start = self.slices[f"{kind} {a + 1}-{b + 1}"].start
                u, v = np.array(terms).T
                columns = slice(start, start + len(terms))
                slope[:, a, columns] = (change[u, :, a] * value[v, :, b]).T / self.half[a]
                slope[:, b, columns] = (value[u, :, a] * change[v, :, b]).T / self.half[b]

    def friction_of(self, p: Float) -> tuple[Float, Float]:
        """Coulomb friction (n,) Nm, and friction as a share of the load (n,)."""
        f = np.concatenate([p[self.slices[f"friction {j + 1}"]] for j in range(self.joints)])
        common, *own = p[self.slices["load friction"]]
        return f, common + np.array(own)

    def _groups(self) -> Iterator[Group]:
        n, own = self.joints, self.cad.reshape(-1, PER_GRAVITY)
        total = own[:, 0].sum()
        for i, (mass, *moment) in enumerate(own):
            reach = max(float(np.linalg.norm(moment)) / mass if mass else 0.0, 0.1)
            stated = link_prior(np.array([mass, *moment, *[0.0] * 6]), self.link).deviations
            added = body_prior(ADDED * total, reach).deviations
            yield Group("link", (i,), np.hypot(stated, added)[:PER_GRAVITY])
        if self.carries:
            yield Group("payload", (), np.full(3, PAYLOAD))
        yield Group("gain", (), np.full(n, GAIN))
        yield Group("tilt", (), np.full(2, TILT))
        yield Group("zero", (), np.full(n, ZERO))
        for j in range(n):
            yield Group("spring", (j,), np.full(2, SPRING * self.rated[j]))
        for j in range(n):
            yield Group("bent spring", (j,), SPRING * self.rated[j] * DECAY ** np.arange(1, BENT - 1))
        for a, b in self.pairs:
            energy = SPRING * min(self.rated[a] * self.half[a], self.rated[b] * self.half[b])
            for kind, terms in (("hose", degrees(0, PLAIN)), ("bent hose", degrees(PLAIN, BENT))):
                total = np.array(terms).sum(axis=1)
                yield Group(kind, (a, b), energy * DECAY ** (total - 1) / total)
        for j in range(n):
            yield Group("friction", (j,), np.array([FRICTION * self.rated[j]]))
        yield Group("load friction", (), LOAD_FRICTION * np.array([1.0, *[0.3] * n]))


def legendre(x: Float) -> tuple[Float, Float]:
    """Legendre's polynomials of degree 0 to ``BENT`` at ``x`` (…), and their derivatives: (``BENT`` + 1, …) each."""
    value, slope = [np.ones_like(x), x], [np.zeros_like(x), np.ones_like(x)]
    for k in range(2, BENT + 1):
        value.append(((2 * k - 1) * x * value[-1] - (k - 1) * value[-2]) / k)
        slope.append(slope[-2] + (2 * k - 1) * value[-2])
    return np.stack(value), np.stack(slope)
