"""What the columns of a recording are called, and which quantity of which joint each one is.

Three families of names are known: this project's tables (``q_1``, ``tau_1``, ``power``), Universal Robots' RTDE records
(``actual_q_0``, ``target_qd_0``) and cellwatt's own channels (``arm.joint_1.position``, ``supply.power``). Joints are
numbered from 1, or from 0 where there is a 0.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from cellwatt.errors import RecordingError

Quantity = Literal[
    "position",
    "velocity",
    "acceleration",
    "torque",
    "current",
    "temperature",
    "target_position",
    "target_velocity",
    "target_acceleration",
]

CLOCKS = ("t", "timestamp", "time")
"""Names of the time column; the first that is there counts."""

_STEMS: Mapping[str, Quantity] = {
    "q": "position",
    "actual_q": "position",
    "qd": "velocity",
    "actual_qd": "velocity",
    "qdd": "acceleration",
    "tau": "torque",
    "actual_current_as_torque": "torque",
    "current": "current",
    "actual_current": "current",
    "temperature": "temperature",
    "joint_temperatures": "temperature",
    "target_q": "target_position",
    "target_qd": "target_velocity",
    "target_qdd": "target_acceleration",
}
"""In the order in which they are preferred where a file has several for one quantity."""
_CHANNELS: Mapping[str, Quantity] = {
    "position": "position",
    "velocity": "velocity",
    "acceleration": "acceleration",
    "torque": "torque",
    "current": "current",
    "temperature": "temperature",
    "target_position": "target_position",
    "target_velocity": "target_velocity",
    "target_acceleration": "target_acceleration",
}
_FLAT = re.compile(r"(?P<stem>.+)_(?P<number>\d+)")
_CHANNEL = re.compile(r"(?:(?P<source>.+)\.)?joint_(?P<number>\d+)\.(?P<channel>\w+)")
_POWER = re.compile(r"(?:.+\.)?supply\.power")

PLAIN: Mapping[Quantity, str] = {
    "position": "q",
    "velocity": "qd",
    "acceleration": "qdd",
    "torque": "tau",
    "current": "current",
    "temperature": "temperature",
    "target_position": "target_q",
    "target_velocity": "target_qd",
    "target_acceleration": "target_qdd",
}
"""How a table calls a quantity, for messages."""


@dataclass(frozen=True)
class Columns:
    """The columns that count: names by quantity, in the order of the joints, and the supply's power."""

    joints: Mapping[Quantity, tuple[str, ...]]
    power: str | None

    def names(self) -> tuple[str, ...]:
        """All of them."""
        per_joint = [name for family in self.joints.values() for name in family]
        return (*per_joint, *([] if self.power is None else [self.power]))


def columns_of(names: Sequence[str], place: str) -> Columns:
    """Sort the names of a file's columns.

    Raises ``RecordingError``, beginning with ``place``, where two sources give the same quantity or a joint is missing.
    """
    families: dict[Quantity, dict[str, dict[int, str]]] = {}
    for name in names:
        if (known := _known(name)) is not None:
            quantity, family, number = known
            families.setdefault(quantity, {}).setdefault(family, {})[number] = name
    joints = {quantity: _in_order(_preferred(found, quantity, place), place) for quantity, found in families.items()}
    return Columns(joints, _power(names, place))


def listed(names: Sequence[str], most: int = 12) -> str:
    """Names for a message, cut where they are many."""
    return ", ".join(names[:most]) + (" …" if len(names) > most else "")


def _known(name: str) -> tuple[Quantity, str, int] | None:
    """Quantity, family (stem or source) and joint number of a column."""
    if (match := _FLAT.fullmatch(name)) is not None and match["stem"] in _STEMS:
        return _STEMS[match["stem"]], match["stem"], int(match["number"])
    if (match := _CHANNEL.fullmatch(name)) is not None and match["channel"] in _CHANNELS:
        return _CHANNELS[match["channel"]], f"{match['source'] or ''}.", int(match["number"])
    return None


def _preferred(families: Mapping[str, dict[int, str]], quantity: str, place: str) -> dict[int, str]:
    plain = [stem for stem in _STEMS if stem in families]
    if plain:
        return families[plain[0]]
    if len(families) > 1:
        sources = ", ".join(sorted(source.rstrip(".") for source in families))
        raise RecordingError(f"{place}: several sources give joint_1.{quantity} ({sources}): keep one arm's columns")
    return next(iter(families.values()))


def _in_order(family: Mapping[int, str], place: str) -> tuple[str, ...]:
    first = min(min(family), 1)
    numbers = range(first, max(family) + 1)
    if missing := [number for number in numbers if number not in family]:
        name = family[max(family)]
        gone = ", ".join(re.sub(r"\d+(?=\D*$)", str(number), name) for number in missing)
        raise RecordingError(f"{place}: no column {gone}; there are {listed([family[i] for i in sorted(family)])}")
    return tuple(family[number] for number in numbers)


def _power(names: Sequence[str], place: str) -> str | None:
    if "power" in names:
        return "power"
    found = [name for name in names if _POWER.fullmatch(name)]
    if len(found) > 1:
        raise RecordingError(f"{place}: several columns give the supply's power ({listed(found)}): keep one")
    return found[0] if found else None
