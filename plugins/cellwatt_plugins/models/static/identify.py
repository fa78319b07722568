"""Identification of an arm from held poses: physics with evidence, and a model of its residual if that helps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.scheduler import spread
from cellwatt_plugins.models.static.basis import Basis, gravity_parameters, joint_limits
from cellwatt_plugins.models.static.effects import Effects
from cellwatt_plugins.models.static.evidence import Belief, Posterior, fit
from cellwatt_plugins.models.static.leftover import Leftover, learned
from cellwatt_plugins.models.static.poses import Poses
from cellwatt_plugins.robot import Arm

FOLDS: Final = 5
SEED: Final = 0
"""Seed of the folds."""
_NOISE: Final = 0.002  # of the rated torque, prior
_NEEDS: Final = {
    "link": -np.inf,
    "payload": -np.inf,
    "friction": 0.0,
    "load friction": 0.0,
}  # every arm's masses differ from the description, and every joint has friction
_NEEDED: Final = 3.0  # evidence, natural log: twenty to one
_IDLE: Final = 0.01  # assumed torque of a joint that needs none, as a share of the strongest joint's
_ODD: Final = 6.0  # standard deviations
_IMPOSSIBLE: Final = 5.0  # standard deviations by which friction must be below 0
_ROUNDS: Final = 4  # of leaving out outliers: the worst outlier hides the next


@dataclass(frozen=True)
class HeldArm:
    """An arm that holds poses, before any measurement."""

    arm: Arm
    limits: Float
    """(n, 2) rad."""

    @classmethod
    def of(cls, arm: Arm, q: Float) -> HeldArm:
        """The arm with its joints' ranges: the description's, else those of the poses ``q`` (N, n) rad."""
        return cls(arm, joint_limits(arm.description, q))

    def basis(self, poses: Poses) -> Basis:
        """Return the basis of some poses; it does not depend on their ``torque``."""
        return Basis.of(self.arm.body, self.limits, poses.q, np.sign(poses.approach), poses.payload)

    def effects(self, poses: Poses) -> Effects:
        """The parameters of this arm; a joint without a rated torque is assumed to need half of it in these poses."""
        used = np.abs(poses.torque).max(axis=0)
        thought = 2.0 * np.maximum(used, _IDLE * max(float(used.max()), 1.0))
        stated = self.arm.column("rated_torque")
        rated = np.where(stated > 0, stated, thought)
        half = 0.5 * (self.limits[:, 1] - self.limits[:, 0])
        link = self.arm.description.tolerances.link
        return Effects(gravity_parameters(self.arm.body), rated, half, link, poses.payload_known)


@dataclass(frozen=True)
class Identified:
    """An arm as identified from its held poses."""

    effects: Effects
    posterior: Posterior
    leftover: Leftover | None
    odd: NDArray[np.bool_]
    """(N, n): outliers, which were not used."""

    def torque(self, basis: Basis) -> Float:
        """Torques (N, n) Nm; for a joint with unknown approach, the mean of the two directions."""
        return np.asarray(self.holding(self.load(basis), basis.direction)[0])

    def load(self, basis: Basis) -> Float:
        """Load without friction, (N, n) Nm."""
        load, _ = self.effects.load(basis, self.posterior.mean)
        return load if self.leftover is None else load + self.leftover(basis.share)

    @property
    def driven_by_friction(self) -> NDArray[np.bool_]:
        """True (n,) for joints whose friction is clearly below 0, which is impossible."""
        at = [self.effects.slices[f"friction {j + 1}"].start for j in range(self.effects.joints)]
        return np.asarray(self.posterior.mean[at] < -_IMPOSSIBLE * self.posterior.deviation[at])

    def total(self, basis: Basis) -> Float:
        """Sum of absolute torques (N,) Nm, eq. 5, as in ``holding``."""
        return np.asarray(self.holding(self.load(basis), basis.direction)[1][:, 0])

    def holding(self, load: Any, direction: Any) -> tuple[Any, Any]:
        """Torques (N, n) Nm and the sum of their absolute values (N, 1), eq. 5, by the ``load`` (N, n) Nm without
        friction and the ``direction`` of approach: arrays or tensors.

        For an unknown approach, the larger of load and friction counts as the absolute torque of a joint.
        """
        held = self.effects.friction(self.posterior.mean, load)
        torque, known = load + direction * held, np.abs(direction)
        each = known * np.abs(torque) + (1.0 - known) * np.maximum(np.abs(load), np.abs(held))
        return torque, each.sum(axis=-1, keepdims=True)


def identify(basis: Basis, torque: Float, effects: Effects) -> Identified:
    """Physics alone, for measured ``torque`` (N, n) Nm; only torques with a known direction of approach are used."""
    used = np.isfinite(torque) & (basis.direction != 0)
    prior = _prior(effects)
    odd = np.zeros_like(used)
    posterior = fit(lambda p: effects.evaluate(basis, p), torque, used, prior)
    for _ in range(_ROUNDS):
        rest = torque - effects.evaluate(basis, posterior.mean)[0]
        found = used & _outlying(rest, used, posterior.noise)
        if not (found & ~odd).any():
            break
        odd = found
        posterior = fit(lambda p: effects.evaluate(basis, p), torque, used & ~odd, prior)
    return Identified(effects, posterior, None, odd)


@dataclass(frozen=True)
class Checked:
    """A model of all poses, and predictions of each pose by models that were not trained on it."""

    model: Identified
    predicted: Float
    """(N,) Nm: sum of absolute torques of held-out poses."""
    blind: Float
    """(N,) Nm: the same, predicted without the direction of approach."""


def identify_checked(poses: Poses, basis: Basis, effects: Effects) -> Checked:
    """The best model; it has the Gaussian process only if that improves the predictions of held-out poses."""
    parts = folds(len(poses))
    held_out = spread(_left_out, parts, "models that leave poses out", shared=(poses, basis, effects))
    plain, with_rest = np.empty((2, 2, len(poses)))
    gained = np.empty(len(poses))
    for part, one in zip(parts, held_out, strict=True):
        plain[:, part], with_rest[:, part], gained[part] = one
    model = identify(basis, poses.torque, effects)
    if np.mean(gained) > 2.0 * np.std(gained) / np.sqrt(len(gained)):
        return Checked(with_leftover(model, basis, poses.torque), *with_rest)
    return Checked(model, *plain)


def _left_out(part: NDArray[np.intp], known: tuple[Poses, Basis, Effects]) -> tuple[Float, Float, Float]:
    """Sums of absolute torques (2, k) Nm of k held-out poses, with and without the approach: physics, and with
    leftover.

    The last item is the gain (k,) of the leftover.
    """
    poses, basis, effects = known
    rest = np.setdiff1d(np.arange(len(poses)), part)
    model = identify(basis.rows(rest), poses.torque[rest], effects)
    fuller = with_leftover(model, basis.rows(rest), poses.torque[rest])
    seen, blind = basis.rows(part), replace(basis.rows(part), direction=np.zeros_like(basis.share[part]))
    totals = [np.stack([m.total(seen), m.total(blind)]) for m in (model, fuller)]
    errors = [((poses.torque[part] - m.torque(seen)) / model.posterior.noise) ** 2 for m in (model, fuller)]
    gained = np.nansum(np.where(seen.direction == 0, np.nan, errors[0] - errors[1]), axis=1)
    return totals[0], totals[1], gained


def with_leftover(model: Identified, basis: Basis, torque: Float) -> Identified:
    """The same model with a process fitted to its residual."""
    used = (basis.direction != 0) & ~model.odd & np.isfinite(torque)
    return replace(model, leftover=learned(basis.share, torque - model.torque(basis), used))


def folds(count: int) -> list[NDArray[np.intp]]:
    """Rows held out in turn; drawn at random, as a Halton sequence repeats its positions."""
    rows = np.random.default_rng(SEED).permutation(count)
    return [np.sort(part) for part in np.array_split(rows, min(FOLDS, count))]


def _prior(effects: Effects) -> Belief:
    needs = np.array([_NEEDS.get(group.kind, _NEEDED) for group in effects.groups])
    every = tuple(range(effects.joints))
    outputs = tuple(group.joints or every for group in effects.groups)
    return Belief(tuple(effects.slices.values()), effects.scale, needs, _NOISE * effects.rated, outputs)


def _outlying(rest: Float, used: NDArray[np.bool_], noise: Float) -> NDArray[np.bool_]:
    usual = np.array([1.4826 * np.median(np.abs(rest[used[:, j], j])) for j in range(rest.shape[1])])
    return np.asarray(np.abs(rest) > _ODD * np.maximum(usual, 0.2 * noise))
