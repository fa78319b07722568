"""Torques with the opposite sign: they follow the motion reversed, and friction gains energy, which is impossible."""

from __future__ import annotations

from typing import Final

import numpy as np

from cellwatt.arrays import Bool, Float

STOPPED: Final = 0.02
"""rad/s over which friction of unknown size changes its sign; wider than the noise of encoders."""
BACK: Final = 0.2
"""Distance that a joint covers in its less frequent direction, as a share of that in the other, if it goes to and fro.

Along one way, friction of any size makes nearly every torque fit nearly every joint.
"""
FOLLOWS: Final = 0.5
"""Correlation of a torque of the wrong sign with the expected one, friction apart."""
LOSS: Final = 0.1
"""Share of a joint's power that friction takes, below which it may take none."""


def opposite(torque: Float, expected: Float, velocity: Float, loss: float = LOSS) -> Bool:
    """True (n,) for joints whose torque (N, n) Nm follows the expected one with the other sign, and lacks friction.

    ``velocity`` is in rad/s; rows without a torque do not count. With ``loss`` 0, friction must gain energy: the
    gravity of an arm that is mounted upside down does not count then.
    """
    courses = zip(np.isfinite(torque).T, torque.T, expected.T, velocity.T, strict=True)
    return np.array([_opposite(own[k], other[k], speed[k], loss) for k, own, other, speed in courses], np.bool_)


def _opposite(torque: Float, expected: Float, velocity: Float, loss: float) -> bool:
    friction = np.column_stack([np.tanh(velocity / STOPPED), velocity])
    beside = np.column_stack([friction, np.ones_like(velocity)])
    both = np.column_stack([torque, expected])
    own, other = (both - beside @ np.linalg.lstsq(beside, both, rcond=None)[0]).T
    if float(own @ other) >= -FOLLOWS * float(np.linalg.norm(own) * np.linalg.norm(other)):
        return False
    terms = np.column_stack([beside, expected])
    found = np.linalg.lstsq(terms, torque, rcond=None)[0]
    lost = float(np.mean(friction @ found[:2] * velocity))
    return lost < loss * float(np.mean(np.abs(torque * velocity)))


def to_and_fro(velocity: Float) -> Bool:
    """True (n,) for the joints that go to and fro at ``velocity`` (N, n) rad/s; see ``BACK``."""
    less, more = np.sort([np.maximum(velocity, 0.0).mean(axis=0), np.maximum(-velocity, 0.0).mean(axis=0)], axis=0)
    return np.asarray(less > BACK * more, np.bool_)
