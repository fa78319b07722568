"""Recordings of an arm as if the motor of one joint also turned with another one: its friction then loads both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from real.recording import Float, Recording

REVERSES = 0.02
"""rad/s within which the friction reverses."""


def coupled(recordings: list[Recording], first: int, second: int, ratio: float, constants: Float) -> list[Recording]:
    """The recordings with the friction of joint ``second``, by a plain fit to them, at its speed plus ``ratio`` times
    that of joint ``first``.

    Joints are 0-based; ``constants`` (n,) Nm/A turn currents to torques, 1 where torques were recorded.
    """
    laws, torques = [], []
    for each in recordings:
        q, qd = each.position[:, second], each.velocity[:, second]
        others = np.column_stack([np.gradient(qd, each.time), np.sin(q), np.cos(q), np.ones(len(q))])
        laws.append(np.column_stack([_friction(qd), others]))
        torques.append(each.effort(constants)[:, second])
    fitted = np.linalg.lstsq(np.concatenate(laws), np.concatenate(torques), rcond=None)[0]
    own = np.maximum(fitted[:2], 0.0)
    out = []
    for each in recordings:
        alone = each.velocity[:, second]
        together = _friction(ratio * each.velocity[:, first] + alone) @ own
        more = np.zeros_like(each.position)
        more[:, first], more[:, second] = ratio * together, together - _friction(alone) @ own
        if each.current is None:
            out.append(replace(each, torque=each.effort(constants) + more))
        else:
            out.append(replace(each, current=each.current + more / constants))
    return out


def _friction(speed: Float) -> Float:
    """Coulomb and viscous friction (N, 2) for a coefficient of 1 each."""
    return np.column_stack([np.tanh(speed / REVERSES), speed])
