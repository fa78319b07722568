"""Fits factors on the torque and the friction of each joint with the rigid-body model (eqs 6, 7 of ECDP).

For each joint, τ = g (Y(q, θ̇, θ̈) (π₀ + δ) + J θ̈) + friction(θ̇), where τ is the reported torque and g = 1/h. With g of
the previous round as the factor of δ, the equation is linear in g, in the deviations δ of the links from the URDF, in
the rotor inertia and in friction. τ contains noise and friction that (7) does not model, so it is the dependent
variable: as a regressor (h τ = …) it would pull h to zero if most of it is friction. The payload's mass is known, so
that the difference between loaded and unloaded runs determines h more closely than the tolerance of the inertias.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float, joined
from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.recordings import Recorded
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.effects import FRICTION
from cellwatt_plugins.robot.effects.friction import Sliding
from cellwatt_plugins.robot.motion import direction, rates, smooth
from cellwatt_plugins.robot.priors import body_prior, links_prior
from cellwatt_plugins.robot.regression import Prior, solve, variance_of

SAMPLES = 250
"""Samples used per run; more would improve the fit little and take time."""
WINDOW = (7, 41)
"""Shortest and longest smoothing window, samples …"""
CYCLES = 1.6
"""… and bandwidth in cycles per window."""
MISSED = 0.01
"""First guess of the torque that rigid bodies and friction (7) do not explain, as a share."""
LEAST = 0.003
"""Smallest unexplained torque of a joint, as a share of the arm's largest torque."""
ALIKE = 10.0
"""Neighbouring samples over which the model's error is correlated; they count as one."""
ROUNDS = 6
"""Number of fits, each weighted by the residual of the one before."""
FURTHEST = 3.0
"""Largest factor between reported and true torque, either way."""
TOOL = 0.1
"""Distance of the payload's centre from the flange, m, one standard deviation."""
SLOWEST = 0.01
"""Speed below which the arm is at rest, rad/s."""
LAWS = {law.name: (law, *law.split) for law in FRICTION if law.split}
"""Fitted laws of friction, with the prior spread of each coefficient and the law's shape."""
OFFSET = "offset"
"""Constant torque in addition to friction, Nm; its prior spread is 1 Nm."""


@dataclass(frozen=True)
class RigidFit:
    """Factors and friction of each joint, (n,) each.

    ``torque`` is h, the factor on the reported torque; ``friction`` holds the coefficient of each of ``LAWS``, and
    ``OFFSET`` Nm.
    """

    torque: Float
    uncertainty: Float
    friction: Mapping[str, Float]


@dataclass(frozen=True)
class _Samples:
    position: Float
    velocity: Float
    acceleration: Float
    torque: Float
    payload: Float


def fit_rigid(arm: Arm, runs: Sequence[Recorded], uncertainty: Float) -> RigidFit:
    """Fit all runs; ``uncertainty`` (n,) is that of the factors, which are expected to be 1.

    Raises ``RecordingError`` if no run moves for long enough.
    """
    samples = _gather(runs)
    value = samples.torque.reshape(-1)
    n, given = arm.joints, np.ones(arm.joints)
    prior = _prior(arm, float(samples.payload.max()), uncertainty)
    largest = np.abs(samples.torque).max(axis=0)
    least = LEAST * float(largest.max())
    variance = np.tile((MISSED * largest + least) ** 2, len(samples.position))
    # Fast runs are smoothed most, so the model's error is estimated per joint and run.
    kind = np.add.outer(n * (np.arange(len(samples.position)) // SAMPLES), np.arange(n)).reshape(-1)
    for _ in range(ROUNDS):
        design = _equations(arm, samples, given)
        fit = solve(design, value, ALIKE * variance, prior)
        variance = variance_of(value - design @ fit.coefficients, kind, 0.0) + least**2
        given = np.clip(fit.coefficients[:n], 1 / FURTHEST, FURTHEST)
    lower = np.full(len(prior.mean), -np.inf)
    # Friction dissipates energy: all its coefficients but the offset are positive.
    lower[-(len(LAWS) + 1) * n : -n] = 0.0
    bounded = fit.bounded(lower)
    friction = bounded[-(len(LAWS) + 1) * n :].reshape(-1, n) / given
    return RigidFit(1.0 / given, fit.deviations[:n] / given**2, dict(zip((*LAWS, OFFSET), friction, strict=True)))


def _gather(runs: Sequence[Recorded]) -> _Samples:
    parts: list[_Samples] = []
    for run in runs:
        motion = run.motion
        moving = np.flatnonzero(np.abs(motion.velocity).max(axis=1) > SLOWEST)
        if len(moving) < SAMPLES:
            continue
        window = int(np.clip(len(moving) // 200, *WINDOW)) | 1
        chosen = moving[np.linspace(0, len(moving) - 1, SAMPLES).astype(int)]
        bandwidth = CYCLES / (window * motion.step)
        q, tau = (smooth(s, motion.step, bandwidth)[chosen] for s in (motion.position, motion.torque))
        qd, qdd, _ = (s[chosen] for s in rates(motion.velocity, motion.step, bandwidth))
        parts.append(_Samples(q, qd, qdd, tau, np.full(len(chosen), run.payload)))
    if not parts:
        raise RecordingError(f"{runs[0].motion.place}: no run has {SAMPLES} samples in motion: record longer or faster")
    return joined(parts)


def _equations(arm: Arm, samples: _Samples, given: Float) -> Float:
    """Design (N n, columns): g | links | rotor | payload's centre and inertia | friction; ``given`` (n,): g so far."""
    regressor = arm.body.regressor(samples.position, samples.velocity, samples.acceleration)
    last = regressor[:, :, -PER_LINK:]
    known = regressor @ arm.body.parameters() + arm.column("rotor_inertia") * samples.acceleration
    known = known + last[:, :, 0] * samples.payload[:, None]
    velocity = samples.velocity
    sliding = Sliding(velocity, direction(velocity), known)
    own = [*(law.torque(sliding, shape) for law, _, shape in LAWS.values()), np.ones_like(velocity)]
    loaded = (samples.payload > 0).astype(np.float64)[:, None, None]
    deviations = [regressor, _diagonal(samples.acceleration), last[:, :, 1:] * loaded]
    columns = [_diagonal(known), *(part * given[:, None] for part in deviations), *(_diagonal(f) for f in own)]
    return np.concatenate(columns, axis=2).reshape(len(velocity) * arm.joints, -1)


def _diagonal(values: Float) -> Float:
    """(N, n) → (N, n, n): a column for each joint."""
    return np.asarray(values[:, :, None] * np.eye(values.shape[1]))


def _prior(arm: Arm, payload: float, uncertainty: Float) -> Prior:
    """Return the prior of every unknown, in the order of the equations' columns."""
    n, tolerance = arm.joints, arm.description.tolerances
    rotor = tolerance.rotor_inertia * np.maximum(arm.column("rotor_inertia"), 1e-3)
    carried = body_prior(max(payload, 1e-3), TOOL).deviations[1:]
    friction = np.repeat([*(wide for _, wide, _ in LAWS.values()), 1.0], n)
    return Prior.joined(
        Prior.spread(uncertainty, np.ones(n)),
        links_prior(arm.body.parameters(), tolerance.link),
        Prior.spread(np.concatenate([rotor, carried, friction])),
    )
