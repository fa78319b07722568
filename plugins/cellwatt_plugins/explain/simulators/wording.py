"""Summary of a mended simulator for the terminal."""

from __future__ import annotations

from cellwatt_plugins.explain.report.wording import effect_name
from cellwatt_plugins.explain.simulators.mend import Mended, Unwritten
from cellwatt_plugins.explain.simulators.written import Applied

LISTED = 0.05
"""Relative change of a number above which it is listed on a line of its own."""


def mended_in_words(mended: Mended) -> str:
    """Describe what was written, what could not be, and the simulator's error before and after."""
    lines = [f"mended: {mended.path}"]
    listed = [change for change in mended.applied if _worth_a_line(change)]
    lines += [f"  {change.where}: {change.what} {_values(change)}" for change in listed]
    if rest := len(mended.applied) - len(listed):
        lines.append(
            f"  and {rest} other numbers: off by less than {100 * LISTED:.0f} %, or centre and inertia of a body"
        )
    lines += [f"  left out: {_unwritten(finding)}" for finding in mended.left]
    lines += [f"  note: {note}" for note in mended.notes]
    held_out = "" if any(e.channel.startswith("q_") for e in mended.error) else "held-out "
    lines.append(f"  {held_out}error of the simulator, before → after (noise):")
    lines += [
        f"    {e.channel}: {e.before:.3g} → {e.after:.3g} {_plain(e.unit)} ({e.noise_floor:.3g})" for e in mended.error
    ]
    return "\n".join(lines)


def _plain(unit: str) -> str:
    return unit.replace("*", "")


def _unwritten(finding: Unwritten) -> str:
    where = "" if finding.joint is None else f" at joint {finding.joint}"
    return f"{effect_name(finding.effect)}{where}, {finding.rms:.3g} {_plain(finding.unit)} rms: {finding.why}"


def _worth_a_line(change: Applied) -> bool:
    if change.what.startswith(("inertia", "centre")):
        return change.was is None and change.what.startswith("centre")
    if isinstance(change.value, tuple) or isinstance(change.was, tuple) or change.was is None:
        return True
    return abs(change.value - change.was) > LISTED * max(abs(change.value), abs(change.was))


def _values(change: Applied) -> str:
    unit = change.unit.replace("N*m", "Nm").replace("*", "·")
    before = "" if change.was is None else f"{_number(change.was)} → "
    return f"{before}{_number(change.value)} {unit}".rstrip()


def _number(value: float | tuple[float, ...]) -> str:
    return f"({', '.join(f'{v:.3g}' for v in value)})" if isinstance(value, tuple) else f"{value:.3g}"
