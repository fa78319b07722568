"""From the network's probabilities to what is said of a cycle: faulty joints and encoders, or that it cannot tell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.ann.bins import PARTS
from cellwatt_plugins.faults.ann.network import PatternNetwork, Told
from cellwatt_plugins.faults.cycles.findings import CycleFinding, FaultFinding, Kind
from cellwatt_plugins.faults.cycles.live import CycleJudge
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.recording import Recording

Float = NDArray[np.float64]

OFF_PATH = math.radians(0.6)
"""rad from which an encoder is off its path."""
NAMED = 0.5
"""Probability from which a joint is named …"""
MAYBE = 0.1
"""… and from which it is one of those that cannot be told apart, where none is."""
KIND_SURE = 0.7
"""Probability below which it is left open whether a joint off its path or its encoder is faulty."""
SHARE = 0.1
"""A fault shows in moves in which power differs by more than this share of the most."""
NO_NETWORK = "not judged: there is no network for this task at this speed"


class NetworkJudge(CycleJudge):
    """Judges whole cycles of known tasks by a network for each of ``patterns``, None where there is none."""

    def __init__(self, patterns: tuple[Pattern, ...], networks: tuple[PatternNetwork | None, ...]) -> None:
        self.patterns, self.networks, self.meter = patterns, networks, None

    def begun(self, recording: Recording, match: Match) -> None:
        """The network is of whole cycles: nothing is said before."""

    def whole(self, recording: Recording, match: Match) -> CycleFinding:
        """See ``CycleJudge``."""
        pattern, network = self.patterns[match.pattern], self.networks[match.pattern]
        ends = np.array([pattern.moves[0][0], pattern.moves[-1][1]])
        start, end = match.warp.to_recording(ends).tolist()
        speed = round(pattern.speed * match.pace, 3)
        if network is None:
            return CycleFinding(start, end, pattern.task, speed, "healthy", NO_NETWORK, ())
        told = network.tell(recording, match, pattern)
        faults = faults_of(told, network.head.limit, pattern)
        return CycleFinding(start, end, pattern.task, speed, "fault" if faults else "healthy", "", faults)


def faults_of(told: Told, limit: float, pattern: Pattern) -> tuple[FaultFinding, ...]:
    """Faults from ``limit``, the probability of any fault of power, on.

    Where no joint is likely enough to be named, the fault has joint 0 and ``alternatives``: it cannot tell which.
    """
    off = told.off > np.maximum(OFF_PATH, pattern.limits)
    moves = _moves(told.watts, pattern)
    watts = round(float(np.abs(told.watts).max()), 1)
    out = [_of_encoder(told, j, moves, watts) for j in np.flatnonzero(off).tolist()]
    stands = any(fault.kind != "encoder" for fault in out)
    if told.any_joint < limit:
        return tuple(out)
    likely = np.where(off, 0.0, told.joints)
    named = np.flatnonzero(likely >= NAMED).tolist()
    for j in named:
        text = f"Joint {j + 1}: power over the motion is as with a fault in it; it differs by up to {watts:.0f} W"
        out.append(FaultFinding(j + 1, "joint", moves, watts, round(float(likely[j]), 4), (), f"{text}{_in(moves)}."))
    if not named and not stands:
        maybe = tuple((np.flatnonzero(likely >= MAYBE) + 1).tolist())
        which = f"joint {' or '.join(map(str, maybe))}" if maybe else "any joint"
        text = f"Power differs by up to {watts:.0f} W{_in(moves)}, and it cannot be told of which joint: {which}."
        out.append(FaultFinding(0, "joint", moves, watts, round(told.any_joint, 4), maybe, text))
    return tuple(out)


def _of_encoder(told: Told, j: int, moves: tuple[int, ...], watts: float) -> FaultFinding:
    """A joint off its path: whether power says that it is faulty itself, or its encoder, or both."""
    joint, encoder = float(told.joints[j]), float(told.encoders[j])
    kind: Kind = "encoder" if encoder > joint else "joint"
    sure = max(joint, encoder)
    if min(joint, encoder) >= NAMED:
        kind, sure = "joint_and_encoder", min(joint, encoder)
    other: Kind | None = None if sure >= KIND_SURE or kind == "joint_and_encoder" else _other(kind)
    off = f"Joint {j + 1} is off its path by up to {math.degrees(told.off[j]):.1f}°"
    says = {
        "encoder": "power is as if it had moved: its encoder is wrong",
        "joint": "power lacks its share: it stands still",
        "joint_and_encoder": "power lacks its share, and it shows a motion: it and its encoder are faulty",
    }
    text = (
        f"{off}; {says[kind] if other is None else 'its encoder is wrong or it stands still, and power does not tell'}."
    )
    shown = moves if kind != "encoder" else ()
    return FaultFinding(j + 1, kind, shown, watts if kind != "encoder" else 0.0, round(sure, 4), (), text, other)


def _other(kind: Kind) -> Kind:
    return "joint" if kind == "encoder" else "encoder"


def _moves(watts: Float, pattern: Pattern) -> tuple[int, ...]:
    """Moves, from 1, in which power differs."""
    each = np.abs(watts[: PARTS * len(pattern.moves)]).reshape(-1, PARTS).max(axis=1)
    return tuple((np.flatnonzero(each > SHARE * np.abs(watts).max()) + 1).tolist())


def _in(moves: Sequence[int]) -> str:
    return f" (interval{'s' * (len(moves) > 1)} {', '.join(map(str, moves))})" if moves else ""
