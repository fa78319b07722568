"""Content of a log: quantities of named joints, in an order that does not depend on the log's."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError

Quantity = Literal["position", "velocity", "torque", "command"]

COLUMNS: Final[Mapping[Quantity, str]] = {"position": "q", "velocity": "qd", "torque": "tau", "command": "command"}
"""Names of the quantities in tables, before the number or name of the joint."""
COMMANDS: Final = ("command", "cmd", "target", "desired", "goal", "reference")
"""Words in the name of a topic of joint states that mark it as commands to the controller."""
UNITS: Final[Mapping[Quantity, str]] = {"position": "rad", "velocity": "rad/s", "torque": "Nm", "command": "rad"}


@dataclass(frozen=True)
class Log:
    """N samples of n joints; joints are sorted by name, numbers in names by value."""

    path: Path
    joints: tuple[str, ...]
    time: Float
    """(N,) s from the first sample, rising."""
    quantities: Mapping[Quantity, Float]
    """(N, n) in rad, rad/s, Nm (linear axis: m, m/s, N); NaN where a joint has no sample."""
    start: int | None = None
    """UTC ns of the first sample, if the log has it."""

    def columns(self, joints: Sequence[str] = ()) -> dict[str, Float]:
        """Columns ``q_1``, ``qd_1``, ``tau_1``, ``command_1``, … of ``joints``, which are matched by name.

        Without ``joints``, names that differ only in a number are ordered by it; other names stay in the columns'
        names (``q_elbow``), since the order of the joints is unknown. Raises ``RecordingError`` if one of
        ``joints`` is not in the log, or matches several.
        """
        order = placed(self.path, self.joints, joints) if joints else list(range(len(self.joints)))
        counted = bool(joints) or numbered(self.joints)
        labels = [str(i + 1) if counted else self.joints[at] for i, at in enumerate(order)]
        return {
            f"{COLUMNS[quantity]}_{label}": np.ascontiguousarray(values[:, at])
            for quantity, values in self.quantities.items()
            for label, at in zip(labels, order, strict=True)
        }


def placed(path: Path, own: Sequence[str], wanted: Sequence[str]) -> list[int]:
    """Index of each of a robot's joints in a log's: the same name, otherwise the only one that is ``alike``.

    Raises ``RecordingError`` if the log has no such joint, or several.
    """
    taken, places = {each for each in wanted if each in own}, []
    for name in wanted:
        found = [i for i, each in enumerate(own) if each not in taken and alike(each, name)]
        found = [own.index(name)] if name in own else found
        if len(found) != 1:
            fault = "stands for several joints of the log" if found else "is not in the log"
            raise RecordingError(
                f"{path}: joint {name} of the robot {fault}, which has {', '.join(own)}; the robot's joints are "
                f"{', '.join(wanted)}: name them alike"
            )
        places += found
    return places


def natural(name: str) -> list[tuple[int, int, str]]:
    """Sort key by which joint_10 follows joint_2."""
    parts = re.split(r"(\d+)", name)
    return [(1, int(each), "") if each.isdecimal() else (0, 0, each) for each in parts]


def numbered(names: Sequence[str]) -> bool:
    """True for names that differ only in one number, consecutive from 0 or 1."""
    parts = [re.split(r"(\d+)", name) for name in names]
    if len({len(each) for each in parts}) > 1:
        return False
    places = [i for i, each in enumerate(zip(*parts, strict=True)) if len(set(each)) > 1]
    if not places:
        return len(names) == 1
    numbers = [each[places[0]] for each in parts]
    if len(places) > 1 or not all(number.isdecimal() for number in numbers):
        return False
    first = int(numbers[0])
    return first in (0, 1) and [int(number) for number in numbers] == list(range(first, first + len(names)))


def alike(one: str, other: str) -> bool:
    """True if two names may mean one joint: equal except for case, namespaces, prefixes, and ``joint`` at an end."""
    a, b = _plain(one), _plain(other)
    return a == b or a.endswith(f"_{b}") or b.endswith(f"_{a}")


def _plain(name: str) -> str:
    """A name in lower case without namespaces and ``joint`` at its ends."""
    plain = re.sub(r"[^a-z0-9]+", "_", name.rsplit("/", 1)[-1].casefold())
    return re.sub(r"^joint_(?=[a-z])|(?<=[a-z0-9])_joint$", "", plain)
