"""ROS 2 bags and MCAP files: joint states, and the commands of ros2_control."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError, why
from cellwatt.logs.choice import how
from cellwatt.logs.log import COMMANDS, Log, Quantity, natural
from cellwatt.logs.messages import CONTROLLER, STATE, Bag
from cellwatt.record.foreign import listed

log = logging.getLogger(__name__)

_STATE: Final[tuple[tuple[Quantity, str], ...]] = (
    ("position", "position"),
    ("velocity", "velocity"),
    ("torque", "effort"),
)
_POINT: Final[tuple[tuple[Quantity, str], ...]] = (
    ("position", "positions"),
    ("velocity", "velocities"),
    ("torque", "effort"),
)


def is_bag(path: Path) -> bool:
    """True for a rosbag2 folder, with or without metadata, and for an SQLite file."""
    if not path.is_dir():
        return path.suffix == ".db3"
    with suppress(OSError):
        if "rosbag2_bagfile_information" in (path / "metadata.yaml").read_text("utf-8", "replace"):
            return True
    try:
        return any(each.suffix == ".db3" for each in path.iterdir())
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error)}") from error


@dataclass
class Series:
    """Samples of joints that came in the same messages; ``joints`` in the order of the first message."""

    joints: tuple[str, ...]
    time: list[int] = field(default_factory=list)
    values: dict[Quantity, list[Float]] = field(default_factory=dict)
    """(n,) per sample."""

    def rows(self) -> tuple[np.ndarray[Any, np.dtype[np.int64]], dict[Quantity, Float]]:
        """Times (N,) UTC ns, rising, and values (N, n); of messages with equal stamps the first."""
        time, first = np.unique(np.asarray(self.time, np.int64), return_index=True)
        return time, {quantity: np.stack(values)[first] for quantity, values in self.values.items()}


@dataclass
class Topic:
    """Measured and commanded samples of one topic, by set of joints."""

    name: str
    measured: dict[frozenset[str], Series] = field(default_factory=dict)
    commanded: dict[frozenset[str], Series] = field(default_factory=dict)

    def add(self, kind: str, time: int, content: Any) -> None:
        """Add a message. Raises ``ValueError`` if the lengths of its arrays differ from the number of names."""
        stamp = content.header.stamp
        seconds, ns = _either(stamp, "sec", "secs"), _either(stamp, "nanosec", "nsec", "nsecs")
        when = seconds * 1_000_000_000 + ns or time
        if kind == STATE:
            into = self.commanded if any(word in self.name.casefold() for word in COMMANDS) else self.measured
            _take(into, when, content.name, content, _STATE if into is self.measured else (("command", "position"),))
            return
        reference, feedback = _either(content, "reference", "desired"), _either(content, "feedback", "actual")
        _take(self.commanded, when, content.joint_names, reference, (("command", "positions"),))
        _take(self.measured, when, content.joint_names, feedback, _POINT)


def read(path: Path, choice: Sequence[str] = ()) -> Log:
    """Read the joints of a bag; ``choice`` selects topics if several have them. Raises ``RecordingError``."""
    bag = Bag(path)
    topics: dict[str, Topic] = {}
    states: set[str] = set()
    for message in bag.messages():
        topic = topics.setdefault(message.topic, Topic(message.topic))
        try:
            topic.add(message.type, message.time, message.content)
        except (ValueError, TypeError, AttributeError):
            bag.unread[message.topic] = bag.unread.get(message.topic, 0) + 1
        if message.type == STATE:
            states.add(message.topic)
    if bag.cut:
        log.warning("%s: read up to the point where it is damaged or cut off (%s)", path, bag.cut)
    for name, count in bag.unread.items():
        log.warning("%s: %d messages of %s do not fit their declared type", path, count, name)
    if unknown := [name for name in choice if name not in topics]:
        raise RecordingError(f"{path}: no joints under {', '.join(unknown)}; it has {listed(bag.topics.values())}")
    measured = [topic for topic in topics.values() if topic.measured]
    if not measured:
        raise RecordingError(
            f"{path}: not a recording of cellwatt: it has {listed(bag.topics.values())}; "
            f"joints are read of {STATE} and {CONTROLLER}"
        )
    chosen = [topic for topic in measured if topic.name in choice] or measured
    # A controller repeats the joint states, which are preferred if both were recorded.
    chosen = [topic for topic in chosen if topic.name in states] or chosen
    if len(chosen) > 1:
        raise RecordingError(f"{path}: joints under several topics: {how(path, sorted(t.name for t in chosen))}")
    return _log(path, chosen[0], _commands(path, chosen[0], topics.values(), choice))


def _commands(path: Path, measured: Topic, topics: Iterable[Topic], choice: Sequence[str]) -> list[Series]:
    """Commands of the measured joints."""
    joints = frozenset().union(*measured.measured)
    found = [topic for topic in topics if any(joints & names for names in topic.commanded)]
    found = [topic for topic in found if topic.name in choice] or found
    if len(found) > 1 and not _apart(found):
        names = sorted(f"{measured.name},{topic.name}" for topic in found)
        raise RecordingError(f"{path}: commands under several topics: {how(path, names)}")
    return [series for topic in found for series in topic.commanded.values()]


def _apart(topics: Sequence[Topic]) -> bool:
    """True if no joint is commanded under two topics: one controller per arm."""
    every = [joint for topic in topics for joint in frozenset().union(*topic.commanded)]
    return len(every) == len(set(every))


def _log(path: Path, measured: Topic, commands: Sequence[Series]) -> Log:
    """The samples at the times of the largest series; other series are interpolated, commands held."""
    series = sorted(
        measured.measured.values(), key=lambda each: (-len(each.joints), -len(each.time), sorted(each.joints))
    )
    time, _ = series[0].rows()
    joints = sorted({name for each in series for name in each.joints}, key=natural)
    quantities: dict[Quantity, Float] = {}
    for each in reversed(series):
        when, values = each.rows()
        for quantity, rows in values.items():
            into = quantities.setdefault(quantity, np.full((len(time), len(joints)), np.nan))
            for i, name in enumerate(each.joints):
                into[:, joints.index(name)] = _onto(time, when, rows[:, i])
    for each in commands:
        when, values = each.rows()
        latest = np.searchsorted(when, time, side="right") - 1
        for i, name in enumerate(each.joints):
            if name in joints:
                into = quantities.setdefault("command", np.full((len(time), len(joints)), np.nan))
                into[:, joints.index(name)] = np.where(latest < 0, np.nan, values["command"][latest, i])
    known: dict[Quantity, Float] = {q: values for q, values in quantities.items() if np.isfinite(values).any()}
    return Log(path, tuple(joints), (time - time[0]) * 1e-9, known, start=int(time[0]))


def _onto(time: Any, when: Any, values: Float) -> Float:
    if np.array_equal(time, when):
        return values
    return np.asarray(np.interp(time, when, values, left=np.nan, right=np.nan))


def _take(
    into: dict[frozenset[str], Series],
    time: int,
    names: Sequence[str],
    point: Any,
    fields: Sequence[tuple[Quantity, str]],
) -> None:
    """Add the arrays of a message, ordered like the joints of the first message; empty arrays count as missing."""
    names = tuple(map(str, names))
    arrays = {quantity: np.asarray(getattr(point, name, ()), np.float64) for quantity, name in fields}
    if wrong := [len(each) for each in arrays.values() if len(each) not in (0, len(names))]:
        raise ValueError(f"{wrong[0]} values for {len(names)} joints")
    if len(set(names)) < len(names):
        raise ValueError("a joint twice")
    if not any(len(each) for each in arrays.values()):
        return
    series = into.setdefault(frozenset(names), Series(names))
    order = [names.index(name) for name in series.joints]
    series.time.append(time)
    for quantity, array in arrays.items():
        row = array[order] if len(array) else np.full(len(names), np.nan)
        series.values.setdefault(quantity, []).append(row)


def _either(content: Any, *names: str) -> Any:
    """The first of the fields ``names`` that a message has. Raises ``AttributeError`` if it has none."""
    return getattr(content, next((name for name in names if hasattr(content, name)), names[0]))
