"""The fault of the demo: a spring attached to an elbow joint, and the delay of its alarm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellwatt.demo.seen import Seen
from cellwatt.emulation import ArmSignals

JOINT = 3
"""The elbow."""
SPRING = {"stiffness": 60.0, "rest": 1.4}
"""Stiffness, Nm/rad, and rest position, rad (the elbow's home position): the spring of Sabry et al., 10 N at 0.3 m,
scaled to this arm."""
AFTER = 0.6
"""Largest time from the end of the interval to its alarm, s …"""
LATE = 10.0
"""… and what is added to it on a busy PC, s."""
FAULTY = ("arm", "board")
"""Emulators of the arm to which the spring is attached."""


def spring(at: float) -> str:
    """The spring in words, attached ``at`` s after the epoch of the emulated arm."""
    return f"spring:joint={JOINT},stiffness={SPRING['stiffness']} Nm/rad,rest={SPRING['rest']} rad,at={at} s"


def next_start(after: float, epoch: float) -> float:
    """Next time after ``after``, UTC s, at which the elbow of the emulated arm starts to move."""
    arm = ArmSignals()
    repetition = int((after - epoch) // arm.period)
    starts = [epoch + (repetition + r) * arm.period + s for r in (0, 1) for s in arm.starts(JOINT)]
    return min(s for s in starts if s >= after)


def figures(seen: Seen, hooked: float) -> dict[str, Any]:
    """Figures of the first fault alarm, and the duration of the interval in which the spring began to act."""
    at = hooked * 1e9
    alarms = [a for a in seen.alarms if a["kind"].endswith("_fault") and a["active"]]
    acting = [i for i in seen.intervals if JOINT in i["moving"] and i["end"] > at]
    first = alarms[0] if alarms else None
    return {
        "joint": JOINT,
        "early_alarms": sum(a["received"] < at for a in alarms),
        "named_joint": first["joint"] if first else None,
        "statement": first["statement"] if first else None,
        "delay_s": round((first["received"] - at) * 1e-9, 3) if first else None,
        "interval_s": round((acting[0]["end"] - acting[0]["start"]) * 1e-9, 3) if acting else None,
    }


def problems_of(fault: Mapping[str, Any], *, busy: bool) -> list[str]:
    """Sentences about missing, wrong or late alarms; on a ``busy`` PC the alarm may be ``LATE`` s later."""
    if fault["named_joint"] is None:
        return ["no alarm named the fault"]
    problems = []
    if fault["early_alarms"]:
        problems.append(f"{fault['early_alarms']} alarms before the fault")
    if fault["named_joint"] != fault["joint"]:
        problems.append(f"the alarm names joint {fault['named_joint']}, the spring is on {fault['joint']}")
    if fault["interval_s"] is None or fault["delay_s"] > fault["interval_s"] + AFTER + LATE * busy:
        problems.append(f"the alarm came after {fault['delay_s']} s, the interval lasted {fault['interval_s']} s")
    return problems
