"""Sentences on findings."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from cellwatt_plugins.faults.cycles.examine import Blame, Verdict
from cellwatt_plugins.faults.cycles.match import Match

ANOTHER_PACE = 0.01
"""Smallest relative difference of pace that is reported."""
PAUSE = 0.3
"""A rest that exceeds the task's by more than this, s, is reported as a pause."""
LEAST_SWITCHED, LEAST_WARM = 1.0, 0.03
"""Smallest reported change of the supply's own power, W, and of friction, as a share."""

_WHAT = {
    "friction": "turns harder than in healthy cycles: friction in its gear, bearing or brake",
    "spring": "works against a force that grows with its angle: something pulls or is caught there",
    "winding": "loses more in its winding than in healthy cycles: it is hot or damaged",
    "unheld": "takes no power to hold itself: its drive is cut off, or its belt or coupling is off",
    "drive_cut": "stands still and takes no power: its drive is cut off",
    "belt_off": "stands still while its motor turns without load: its belt or coupling is off",
}


def statement_on(
    joint: int, kind: str, blame: Blame | None, deviation: str, moves: Sequence[int], or_kind: str | None
) -> str:
    """Sentence on a fault; ``joint`` 0-based, largest ``deviation`` of its encoder, ``moves`` from 1."""
    where = f" (interval{'s' * (len(moves) > 1)} {', '.join(map(str, moves))})" if moves else ""
    off = f"The encoder of joint {joint + 1} is off the path by up to {deviation}"
    if or_kind is not None:
        return f"{off}{where}: its encoder is wrong or the joint stands still; power does not show which."
    if blame is None:
        return f"{off}, while power is as in healthy cycles{where}."
    watts = max(blame.watts.max(), -blame.watts.min())
    text = f"Joint {joint + 1} {_WHAT[blame.what]}; power differs by up to {watts:.0f} W{where}"
    if blame.alternatives:
        others = " or ".join(str(j + 1) for j in blame.alternatives)
        text += f"; joint {others} explains it nearly as well"
    return f"{text}." if kind == "joint" else f"{text}. {off}."


def note_on(match: Match, verdict: Verdict) -> str:
    """Describe the harmless differences; empty if there are none."""
    parts = []
    if abs(match.pace - 1.0) > ANOTHER_PACE:
        more = "faster" if match.pace > 1 else "slower"
        parts.append(f"{abs(match.pace - 1.0):.0%} {more} than learned")
    if (seconds := _pause(match)) > PAUSE:
        parts.append(f"paused for {seconds:.1f} s")
    if (part := verdict.harmless.get("part")) is not None:
        parts.append(f"part {'heavier' if part > 0 else 'lighter'} by {abs(part):.2g} kg")
    if (share := verdict.harmless.get("load")) is not None:
        parts.append(f"load {abs(share):.0%} {'higher' if share > 0 else 'lower'}, as of another part")
    if abs(watts := verdict.harmless.get("switched", 0.0)) > LEAST_SWITCHED:
        parts.append(f"the supply takes {abs(watts):.0f} W {'more' if watts > 0 else 'less'}, as if a fan switched")
    if abs(verdict.warm) > LEAST_WARM:
        parts.append(f"friction {abs(verdict.warm):.0%} {'higher' if verdict.warm > 0 else 'lower'} in all joints: ")
        parts[-1] += "the arm is colder" if verdict.warm > 0 else "the arm is warmer"
    return "; ".join(parts)


def _pause(match: Match) -> float:
    """Largest excess of a rest, or of a stop within a move, over the task's, s."""
    edges = list(zip(match.warp.tau, match.warp.t, strict=True))
    return max(((b[1] - a[1]) - (b[0] - a[0]) / match.pace for a, b in pairwise(edges)), default=0.0)
