"""Drive gains from recordings without and with a load of known mass.

Without a known mass the gains have one free common factor: links, friction and payload scale with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from cellwatt_plugins.robot import Body
from real.identify import diagonal, spread, with_payload
from real.recording import Float, Recording

ROUNDS = 3
"""Of finding the load torque that load-dependent friction rests on, and the joints' weights."""
PAYLOAD_SPREAD = np.array([1.0, 1.0, 1.0, *(6 * [0.3])])
"""kg m and kg m²: how large the payload's first moments and inertia may be."""


def calibrated_gains(
    without: Sequence[Recording], loaded: Sequence[Recording], mass: float, body: Body, gain: Float
) -> Float:
    """Gains (n,) Nm/A with which the ``loaded`` recordings carry ``mass`` kg more than those ``without``.

    Links, each joint's friction (constant, viscous, load-dependent) and the payload's place and inertia are free, its
    mass is not. Load-dependent friction belongs in it: on a harmonic drive it is 6 % of the load, which a gain would
    otherwise take up.
    """
    columns, effort, payload = with_payload(without, loaded, body, gain)
    joints = body.joints
    signs = np.einsum("njj->nj", columns[:, :, 11 * joints : 12 * joints])
    load = np.zeros_like(effort)
    factor, weight = np.ones(joints), np.ones(joints)
    believed = np.concatenate([body.parameters(), np.zeros(5 * joints + 9)])
    free = np.concatenate([spread(body), PAYLOAD_SPREAD, np.ones(joints)])
    for _ in range(ROUNDS):
        known = mass * payload[:, :, 0]
        fit = _Fit.of(
            np.concatenate([columns, payload[:, :, 1:], diagonal(np.abs(load) * signs)], axis=2), known, effort
        )
        factor, solved = fit.best(factor, weight, believed, free)
        weight = 1 / fit.residual(factor, solved)
        moments = np.concatenate([[mass], solved[14 * joints : 14 * joints + 9]])
        load = columns[:, :, : 10 * joints] @ solved[: 10 * joints] + payload @ moments
    return np.asarray(gain * factor)


@dataclass(frozen=True)
class _Fit:
    """Sums of measured / factor = columns · parameters + known, per joint, so that a trial of factors costs little.

    What is minimised is the error of the measured current: in torque, small factors would make any error small.
    """

    square: Float
    """(n, p, p)."""
    with_effort: Float
    """(n, p)."""
    with_known: Float
    """(n, p)."""
    moments: Float
    """(n, 3): sums of effort², effort · known and known²."""
    count: int

    @staticmethod
    def of(columns: Float, known: Float, effort: Float) -> _Fit:
        by_joint = columns.transpose(1, 0, 2)
        return _Fit(
            by_joint.transpose(0, 2, 1) @ by_joint,
            np.einsum("nji,nj->ji", columns, effort),
            np.einsum("nji,nj->ji", columns, known),
            np.stack([np.sum(a * b, axis=0) for a, b in ((effort, effort), (effort, known), (known, known))], axis=1),
            len(effort),
        )

    def best(self, factor: Float, weight: Float, believed: Float, spread: Float) -> tuple[Float, Float]:
        """Factors (n,), found from ``factor`` on, and parameters (p,) of the least cost."""

        def cost(log: Float) -> float:
            return self.solve(np.exp(log), weight, believed, spread)[1]

        best = np.exp(minimize(cost, np.log(factor)).x)
        return best, self.solve(best, weight, believed, spread)[0]

    def solve(self, factor: Float, weight: Float, believed: Float, spread: Float) -> tuple[Float, float]:
        """Best parameters (p,) for given factors (n,), and the cost: squared errors and distance from the prior."""
        share = weight**2 / factor**2
        normal = np.einsum("j,jab->ab", share, self.square) + np.diag(1 / spread**2)
        right = np.einsum("j,ja->a", share, factor[:, None] * self.with_effort - self.with_known) + believed / spread**2
        solved = np.linalg.solve(normal, right)
        errors = self.count * np.square(self.residual(factor, solved) * weight)
        return solved, float(np.sum(errors) + np.sum(np.square((solved - believed) / spread)))

    def residual(self, factor: Float, solved: Float) -> Float:
        """Root mean square (n,) of the errors of effort, in its own unit."""
        effort2, both, known2 = self.moments.T
        model2 = known2 + 2 * self.with_known @ solved + np.einsum("a,jab,b->j", solved, self.square, solved)
        crossed = both + self.with_effort @ solved
        return np.asarray(np.sqrt(np.maximum(effort2 - 2 * crossed / factor + model2 / factor**2, 1e-12) / self.count))
