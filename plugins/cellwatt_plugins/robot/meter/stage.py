"""The live side of slow meters: window and delay of their values, found from frames and compared with the declared."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cellwatt.alarms import AlarmBook
from cellwatt.arrays import Float, Nanoseconds
from cellwatt.channel import Quality
from cellwatt.errors import ConfigError
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.quantity import Seconds
from cellwatt.results import Alarm, Result
from cellwatt.stage import CellInfo, Stage, StageSettings
from cellwatt_plugins.robot.meter.find import find
from cellwatt_plugins.robot.meter.kinds import Course, kinds_of_motion, kinds_of_power
from cellwatt_plugins.robot.meter.model import Meter, Readings
from cellwatt_plugins.robot.motion import rates

POWER: Final = "supply.power"
"""Name that drivers give to the power of a supply."""
MEMORY: Final = 120.0
"""Length in s of the frames in which a meter is found."""
SHORTEST: Final = 2.0
"""Shortest stretch in s of motion without a gap that is used."""
EFFORTS: Final = ("torque", "current")
"""Quantities of joints beside positions, the better first: each explains more of the power than motion alone."""
DOUBT: Final = 3.0
"""Standard deviations by which a window must differ from the declared one …"""
SHARE: Final = 0.2
"""… and share of the declared one, for a warning."""
NEWS: Final = 0.01
"""Change in s of window or delay from which they are reported again."""


class MeterSettings(StageSettings):
    """Finds over which time the values of slow power meters are averaged, and how late they come."""

    power: str | None = None
    """Channel of the power; left out: ``supply.power`` of every source that is slower than the frames."""
    arm: str | None = None
    """Source with the joints that the meter supplies; left out: the one whose motion explains most of the power."""
    every: Seconds = Field(default=60.0, gt=0)
    """Time between two searches."""


@dataclass(frozen=True)
class _Arm:
    source: str
    positions: tuple[int, ...]
    efforts: tuple[int, ...]
    """Columns of the frames; efforts may be empty."""


class MeterStage(Stage[MeterSettings]):
    """Raises alarms ``meter_timing``, one per meter: information, or a warning if it differs from the declared
    window."""

    Settings = MeterSettings
    title = "averaging window and delay of a slow power meter, found from the motion of an arm"

    def __init__(self, name: str, settings: MeterSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        self._meters = _meters(layout, settings.power)
        self._arms = _arms(layout, settings.arm)
        self._seen: deque[tuple[NDArray[Any], ...]] = deque()
        """Frames of the last minutes: times (n,) ns, all values, stamps of the meters' columns, and which are
        present."""
        self._looked: int | None = None
        self._announced: dict[int, Meter] = {}
        self._book = AlarmBook()

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """Alarms about meters whose window and delay are now known or have changed."""
        if not len(frames):
            return ()
        stamps = np.column_stack([frames.stamps(column) for column in self._meters])
        there = frames.quality[:, list(self._meters)] != Quality.MISSING
        self._seen.append((frames.time, frames.values, stamps, there))
        now = int(frames.time[-1])
        while len(self._seen) > 1 and now - self._seen[0][0][0] > MEMORY * 1e9:
            self._seen.popleft()
        if self._looked is None:
            self._looked = now
        if now - self._looked < self.settings.every * 1e9:
            return ()
        self._looked = now
        return self._look()

    def close(self) -> Sequence[Result]:
        """Alarms from all frames since the last search."""
        return self._look() if self._seen else ()

    def _look(self) -> list[Result]:
        time, values, stamps, there = (np.concatenate(part) for part in zip(*self._seen, strict=True))
        found: list[Result] = []
        for k, column in enumerate(self._meters):
            channel = self.layout.channels[column]
            shown = stamps[there[:, k], k], values[there[:, k], column]
            fits = [(meter, arm) for arm in self._arms if (meter := self._found(time, values, shown, channel, arm))]
            if not fits:
                continue
            meter, arm = min(fits, key=lambda fit: fit[0].unexplained)
            before = self._announced.get(column)
            if before is None or _differs(before, meter):
                self._announced[column] = meter
                found += self._book.raise_(_alarm(self.name, channel, meter, arm, int(time[0]), int(time[-1])))
        return found

    def _found(
        self, time: Nanoseconds, values: Float, shown: tuple[Nanoseconds, Float], channel: FrameChannel, arm: _Arm
    ) -> Meter | None:
        """The meter, as found from the motion of one arm, and from its efforts if it has any."""
        positions, efforts = values[:, arm.positions], values[:, arm.efforts]
        if np.isnan(efforts).all():
            efforts = efforts[:, :0]
        least = SHORTEST * 1e9 / self.layout.step
        origin, known, courses = int(time[0]), [], []
        for s in _whole(time, np.hstack([positions, efforts]), self.layout.step):
            came, values_there = _new(*shown, time[s], origin)
            if s.stop - s.start >= least and len(came) > 1:
                known.append((came, values_there))
                courses.append(_course(time[s] - origin, positions[s], efforts[s]))
        if not known:
            return None
        interval = float(np.median(np.concatenate([np.diff(came) for came, _ in known])))
        readings = [Readings(came, value, interval) for came, value in known]
        return find(readings, courses, usual=channel.window or None)


def _new(stamp: Nanoseconds, value: Float, during: Nanoseconds, origin: int) -> tuple[Float, Float]:
    """Times in s from ``origin`` ns and values of the rows (n,), each once, that came ``during`` some frames.

    A held value has the stamp of the row before.
    """
    inside = np.flatnonzero((stamp >= during[0]) & (stamp <= during[-1]))
    new = inside[np.unique(stamp[inside], return_index=True)[1]]
    # A meter that is polled before it has a new value returns the last one again.
    fresh = new[np.flatnonzero(np.diff(value[new], prepend=np.nan) != 0)]
    return np.asarray((stamp[fresh] - origin) * 1e-9, np.float64), value[fresh]


def _meters(layout: Layout, power: str | None) -> tuple[int, ...]:
    """Columns of slow meters. Raises ``ConfigError`` where there are none."""
    if power is not None:
        column = layout.index(power)
        if layout.channels[column].method != "hold":
            raise ConfigError(f"{layout.names[column]} is as fast as the frames: it has no window to find")
        return (column,)
    columns = tuple(i for i, c in enumerate(layout.channels) if c.short == POWER and c.method == "hold")
    if not columns:
        raise ConfigError(f"no source gives a {POWER} that is slower than the frames")
    return columns


def _arms(layout: Layout, arm: str | None) -> list[_Arm]:
    """The arms that may be meant. Raises ``ConfigError`` if there are none."""
    sources = sorted({c.source for c in layout.channels if c.short == "joint_1.position"}) if arm is None else [arm]
    if not sources:
        raise ConfigError("no source gives joint_1.position: a meter's window can only be found from an arm's motion")
    found = []
    for source in sources:
        positions = layout.joints("position", source)
        has = [e for e in EFFORTS if f"{source}.joint_1.{e}" in layout.names]
        efforts = layout.joints(has[0], source) if has else ()
        found.append(_Arm(source, positions, efforts if len(efforts) == len(positions) else ()))
    return found


def _whole(time: Nanoseconds, values: Float, step: int) -> list[slice]:
    """Stretches of neighbouring frames in which no value is missing."""
    there = np.flatnonzero(~np.isnan(values).any(axis=1))
    if not len(there):
        return []
    cuts = np.flatnonzero((np.diff(there) > 1) | (np.diff(time[there]) != step)) + 1
    return [slice(int(part[0]), int(part[-1]) + 1) for part in np.split(there, cuts)]


def _course(time: Nanoseconds, positions: Float, efforts: Float) -> Course:
    """Kinds of power along a stretch."""
    t = np.asarray(time * 1e-9, np.float64)
    step = float(t[1] - t[0])
    if not efforts.shape[1]:
        return Course(t, kinds_of_motion(positions, step))
    _, qd, qdd = rates(positions, step)
    return Course(t, np.column_stack([kinds_of_power(efforts, qd), qd * qdd, qd**2]))


def _differs(before: Meter, now: Meter) -> bool:
    """True if a meter differs from the one reported last."""
    pairs = (
        (before.window, now.window, np.hypot(before.window_spread, now.window_spread)),
        (before.late, now.late, np.hypot(before.late_spread, now.late_spread)),
    )
    return any(abs(old - new) > max(NEWS, DOUBT * float(spread)) for old, new, spread in pairs)


def _alarm(stage: str, channel: FrameChannel, meter: Meter, arm: _Arm, since: int, time: int) -> Alarm:
    """The alarm that describes a meter."""
    declared = channel.window
    off = declared and abs(meter.window - declared) > max(DOUBT * meter.window_spread, SHARE * declared)
    statement = f"{channel.name} is {meter.description}, with a value every {1e3 * meter.interval:.0f} ms (found from "
    statement += f"the motion of {arm.source})"
    if off:
        statement += f"; the declared window is {1e3 * declared:.0f} ms: check the meter's setting, or its window here"
    return Alarm(
        id=f"{stage}.{channel.name}.meter_timing",
        kind="meter_timing",
        severity="warning" if off else "info",
        active=True,
        since=since,
        time=time,
        statement=f"{statement}.",
        source=channel.source,
        evidence={
            "channel": channel.name,
            "arm": arm.source,
            "window_s": round(meter.window, 4),
            "window_spread_s": round(meter.window_spread, 4),
            "late_s": round(meter.late, 4),
            "late_spread_s": round(meter.late_spread, 4),
            "interval_s": round(meter.interval, 4),
            "declared_window_s": declared or None,
            "unexplained_share": round(meter.unexplained, 3),
        },
    )
