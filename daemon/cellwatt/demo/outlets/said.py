"""Words of each outlet about the demo's cell, and the newest that all of them say. Pure."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

POWER: Final = "board.supply.power"
CURRENT: Final = "arm.joint_3.current"
SOURCE: Final = "arm"
"""Source whose samples are counted."""
STATE, SAMPLES, ALARMS = "state", f"samples of {SOURCE}", "alarms that are up"
_FRAMES: Final = 512
"""Frames of an outlet that are kept: 10 s at 50 Hz."""
_STATES: Final = 32

Value = float | str


@dataclass(frozen=True, slots=True)
class Told:
    """A frame or a health message as one outlet tells it.

    ``key`` is what it is recognised by in another outlet: the power of a frame, the samples of a health message.
    ``time`` is that of the frame, UTC ns, where it is told.
    """

    key: float
    values: Mapping[str, Value]
    time: int | None = None


@dataclass
class Said:
    """All that one outlet said."""

    name: str
    frames: deque[Told] = field(default_factory=lambda: deque(maxlen=_FRAMES))
    states: deque[Told] = field(default_factory=lambda: deque(maxlen=_STATES))
    problem: str = "is not reached yet"
    """Reason why nothing is heard now; empty if all is well."""
    fault: str = ""
    """Words and place in which the fault's alarm is told; empty if it is not up."""
    words: str = ""
    """The same, also when it is over."""
    heard: float | None = None
    """UTC s at which the fault's alarm was first heard."""

    def frame(self, values: Mapping[str, float], at: int | None = None) -> None:
        """Take the values of a frame by channel, with its time, UTC ns."""
        _add(self.frames, Told(values[POWER], dict(values), at))

    def state(self, colour: str, samples: float, alarms: float) -> None:
        """Take what a health message says."""
        _add(self.states, Told(samples, {STATE: colour, SAMPLES: samples, ALARMS: alarms}))

    def health(self, text: str | bytes) -> None:
        """Take a health message, JSON."""
        status: dict[str, Any] = json.loads(text)
        source = status.get("sources", {}).get(SOURCE)
        if source is not None:
            self.state(status["state"], source["received"], len(status.get("alarms", ())))

    def alarm(self, words: str) -> None:
        """Take how the fault's alarm is told; empty if it is over."""
        self.fault, self.words = words, words or self.words
        if words and self.heard is None:
            self.heard = time.time()

    @property
    def complete(self) -> bool:
        """True if frames and health were heard."""
        return bool(self.frames and self.states)


def _add(kept: deque[Told], told: Told) -> None:
    if not kept or kept[-1].key != told.key:
        kept.append(told)


def is_fault(kind: str) -> bool:
    """True for the kind of an alarm that names a fault."""
    return kind.endswith("_fault")


def newest_of_all(series: Sequence[Sequence[Told]]) -> list[Told] | None:
    """The newest that is told by all, as each tells it; ``None`` if there is none."""
    if not series:
        return None
    known = [{told.key: told for told in one} for one in series]
    fewest = min(series, key=len)
    for told in reversed(fewest):
        if all(told.key in one for one in known):
            return [one[told.key] for one in known]
    return None


def differing(told: Sequence[Told]) -> list[str]:
    """Names of values that are not the same in all that tell them."""
    names = dict.fromkeys(name for one in told for name in one.values)
    return [name for name in names if len({one.values[name] for one in told if name in one.values}) > 1]


@dataclass
class Compared:
    """Counts what all outlets told alike, and names what they told differently."""

    frames: int = 0
    states: int = 0
    unlike: dict[str, int] = field(default_factory=dict)
    _last: dict[str, float] = field(default_factory=dict)

    def look(self, outlets: Sequence[Said]) -> None:
        """Compare the newest frame and the newest health message that all have told."""
        self.frames += self._one("frame", newest_of_all([outlet.frames for outlet in outlets]))
        self.states += self._one("state", newest_of_all([outlet.states for outlet in outlets]))

    def _one(self, what: str, told: Sequence[Told] | None) -> bool:
        if told is None or self._last.get(what) == told[0].key:
            return False
        self._last[what] = told[0].key
        for name in differing(told):
            self.unlike[name] = self.unlike.get(name, 0) + 1
        return not differing(told)
