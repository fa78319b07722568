"""Compact lists of channels: channels whose names differ only in a number share one line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from cellwatt.runtime.examine import ChannelCheck

_NUMBER = re.compile(r"(?<=_)\d+(?=\.|$)")


def together(names: Iterable[str]) -> dict[str, list[str]]:
    """Group names under a shared title, ``joint_1…6.position``; ``joint_1,3.position`` if numbers are missing."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(_NUMBER.sub("#", name), []).append(name)
    return {like.replace("#", _span(members)): members for like, members in groups.items()}


def _span(members: Sequence[str]) -> str:
    numbers = sorted({int(found[0]) for name in members if (found := _NUMBER.search(name))})
    if len(numbers) > 1 and numbers[-1] - numbers[0] == len(numbers) - 1:
        return f"{numbers[0]}…{numbers[-1]}"
    return ",".join(map(str, numbers))


def summary(channels: Sequence[ChannelCheck]) -> list[str]:
    """Lines like ``joint_1…6.position: -1.6 … 1.4 rad`` for channels that change, and one for all constant channels."""
    by_name = {channel.name: channel for channel in channels}
    lines: list[str] = []
    still: list[str] = []
    for title, names in together(by_name).items():
        lows = [low for name in names if (low := by_name[name].low) is not None]
        highs = [high for name in names if (high := by_name[name].high) is not None]
        unit = f" {by_name[names[0]].unit}".removesuffix(" 1")
        silent = len(names) - len(lows)
        if not lows:
            lines.append(f"{title}: no value")
        elif not silent and min(lows) == max(highs):
            still.append(f"{title} {min(lows):.6g}{unit}")
        else:
            lacking = f", {silent} of {len(names)} without a value" if silent else ""
            lines.append(f"{title}: {min(lows):.4g} … {max(highs):.4g}{unit}{lacking}")
    return [*lines, f"constant: {', '.join(still)}"] if still else lines
