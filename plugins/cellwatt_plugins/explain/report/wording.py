"""Findings in plain words: numbers, names, locations and the verdict; each effect declares its own ``sentence``."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cellwatt.report.numbers import capital, fixed, listed
from cellwatt_plugins.explain.fit.solution import Trial
from cellwatt_plugins.explain.report.trace import joint_of
from cellwatt_plugins.explain.verdict.findings import Alternative, Finding, Findings, Span

UNKNOWN = "unknown"
"""Name of an effect that is not in the library."""
MOST_CAUSES = 3
"""Number of causes named in the verdict's sentence; further ones are counted."""
_NAMES = {"stribeck": "Stribeck", "coulomb": "Coulomb"}
_WORDS = ((0.99, "near certain"), (0.95, "very likely"), (0.8, "likely"), (0.5, "more likely than not"))


def confidence(share: float) -> str:
    """A word and the percentage, never rounded up to certainty."""
    word = next((w for least, w in _WORDS if share >= least), "a guess")
    percent = ">99" if share > 0.99 else f"{math.floor(share * 100 + 1e-9)}"
    return f"{word}, {percent} %"


def effect_name(effect: str) -> str:
    """An effect's identifier in plain words."""
    if effect == UNKNOWN:
        return "an effect that is not in the library"
    text = effect.replace("_dependent", "-dependent").replace("_periodic", "-periodic").replace("_", " ")
    return " ".join(_NAMES.get(word, word) for word in text.split(" "))


def named(what: Finding | Alternative | Trial) -> str:
    """Effect and joint, e.g. ``Stribeck friction (joint 2)``."""
    name = effect_name(what.effect)
    return name if what.joint is None else f"{name} (joint {what.joint})"


def channel_name(channel: str) -> str:
    """A channel's name in plain words."""
    joint = joint_of(channel)
    return f"joint {joint} torque" if joint is not None else "supply power" if channel == "power" else channel


def between(limits: tuple[float, float], suffix: str) -> str:
    """A range with its unit, e.g. ``−0.30 to 0.30 rad/s``."""
    return f"{fixed(limits[0], 2)} to {fixed(limits[1], 2)} {suffix}"


def degrees(limits: tuple[float, float]) -> str:
    """A range of angles in rad and in degrees."""
    return between(limits, "rad") + f" ({fixed(math.degrees(limits[0]), 0)} to {fixed(math.degrees(limits[1]), 0)}°)"


def moments(parts: Sequence[Span], most: int = 2) -> str:
    """The first few stretches of time and how many more there are."""
    text = ", ".join(f"{s.recording} {fixed(s.start, 1)} to {fixed(s.end, 1)} s" for s in parts[:most])
    return text + (f" and {len(parts) - most} more" if len(parts) > most else "")


def _causes(findings: Sequence[Finding]) -> str:
    names = [named(f) for f in findings]
    more = len(names) - MOST_CAUSES
    return listed(names if more <= 0 else [*names[:MOST_CAUSES], f"{more} more"])


def _open_places(findings: Findings) -> str:
    """Locations of an unexplained residual, e.g. ``joint 3 and the supply power``."""
    joints = [f.joint for f in findings.findings if f.effect == UNKNOWN]
    joints += [joint_of(rest.channel) for rest in findings.unexplained if rest.looked_at]
    return listed(_joints(joints) + (["the supply"] if None in joints else []))


def _joints(joints: Sequence[int | None]) -> list[str]:
    """``joint 3``, or ``joints 1``, ``3`` and so on, to be listed; None (the supply) is left out."""
    own = sorted({joint for joint in joints if joint is not None})
    return [f"joint{'s' * (len(own) > 1)} {own[0]}", *map(str, own[1:])] if own else []


def _unsearched(findings: Findings) -> str:
    """Channels that were not analysed, e.g. ``joint 5 was not looked at in full: the time limit was reached``."""
    places = _joints([joint_of(rest.channel) for rest in findings.unexplained if not rest.looked_at])
    verb = "were" if len(places) > 1 else "was"
    return f"{listed(places)} {verb} not looked at in full: the time limit was reached" if places else ""


def verdict(findings: Findings) -> str:
    """The whole outcome in one plain sentence."""
    known = [f for f in findings.findings if f.effect != UNKNOWN]
    missing = [f for f in known if f.kind != "mistuned"]
    mistuned = [f for f in known if f.kind == "mistuned"]
    place = _open_places(findings)
    remains = f"at {place} something" if place else "something"
    late = _unsearched(findings)
    only_late = bool(late) and not place
    if findings.verdict == "unexplained":
        if only_late:
            return f"Recordings and simulation differ; {late}."
        at = f"At {place} recordings" if place else "Recordings"
        return f"{at} and simulation differ, and no known effect explains it{late and '; ' + late}."
    if findings.verdict == "partly_explained":
        causes = missing or mistuned
        names = capital(_causes(causes)) if causes else "Retuning"
        rest = late if only_late else f"{remains} remains unexplained{late and '; ' + late}"
        return f"{names} explain{'s' * (len(causes) < 2)} part of the difference; {rest}."
    if missing:
        off = f"; the simulation's value is off for {_causes(mistuned)}" if mistuned else ""
        return f"The difference is explained: {_causes(missing)}{off}."
    if mistuned:
        return f"Nothing is missing from the simulation; only its value is off for {_causes(mistuned)}."
    if findings.retuned:
        return "No physics is missing from the simulation; some of its numbers are off: they explain the difference."
    if all(joint_of(fit.channel) is None for fit in findings.fit):
        supply = "; the supply's power agrees" if findings.fit else ""
        return f"No torque was compared: no joint whose torque was recorded moved far enough{supply}."
    return "Simulation and recordings agree: what differs is noise and tuning within tolerance."
