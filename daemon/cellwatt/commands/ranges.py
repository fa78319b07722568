"""Summarises many channels in few lines: channels that differ only in a number share one."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cellwatt.runtime.examine import ChannelCheck

_NUMBER = re.compile(r"(?<=_)\d+(?=\.|$)")


def summary(channels: Sequence[ChannelCheck]) -> list[str]:
    """Lines like ``joint_1…6.position: -1.6 … 1.4 rad`` for moving channels, and one for all constant ones."""
    groups: dict[tuple[str, str], list[ChannelCheck]] = {}
    for channel in channels:
        groups.setdefault((_NUMBER.sub("#", channel.name), channel.unit), []).append(channel)
    lines: list[str] = []
    still: list[str] = []
    for (name, unit), members in groups.items():
        title = name.replace("#", _numbers(members))
        lows = [m.low for m in members if m.low is not None]
        highs = [m.high for m in members if m.high is not None]
        silent = len(members) - len(lows)
        if not lows:
            lines.append(f"{title}: no number")
        elif not silent and min(lows) == max(highs):
            still.append(f"{title} {min(lows):.6g}{_unit(unit)}")
        else:
            lacking = f", {silent} of {len(members)} without a number" if silent else ""
            lines.append(f"{title}: {min(lows):.4g} … {max(highs):.4g}{_unit(unit)}{lacking}")
    return [*lines, f"the same all the time: {', '.join(still)}"] if still else lines


def _numbers(members: Sequence[ChannelCheck]) -> str:
    found = [int(m[0]) for c in members if (m := _NUMBER.search(c.name))]
    return span(sorted(set(found))) if found else ""


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def span(numbers: Sequence[int]) -> str:
    """Numbers as text: ``1…6``, or each number if some are left out."""
    if len(numbers) > 1 and list(numbers) == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]}…{numbers[-1]}"
    return ",".join(map(str, numbers))
