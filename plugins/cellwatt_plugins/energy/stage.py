"""The ``energy`` stage: computes the energy of every task by consumer, and advice, from frames and tasks.

Pinocchio is imported when a stage is created, not when its settings are read.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from cellwatt.alarms import AlarmBook, Patience
from cellwatt.arrays import Float, Nanoseconds
from cellwatt.errors import ConfigError, ModelError
from cellwatt.frames import Frames, Layout
from cellwatt.quantity import Fraction, Seconds
from cellwatt.results import Alarm, Energy, Interval, Result, Severity, Task
from cellwatt.stage import CellInfo, Stage
from cellwatt_plugins.robot_name import RobotStageSettings, robot_name

if TYPE_CHECKING:
    from cellwatt_plugins.energy.task_energy import Stretch, TaskEnergy


LONGEST = 600 * 10**9
"""Length of the frames stored, ns; a task that began before them is not split."""
REST = 10**9
"""Shortest rest that updates the power of the electronics, ns."""
FOLLOWED = 300 * 10**9
"""Longest part of a rest, up to its end, that updates it, ns."""
MISSING = 0.02
"""Largest share of a task's frames that may be missing; they are interpolated."""
EARLY_OR_LATE = 10**8
"""Time by which a value of the meter may be early or late, ns, as it covers 0.1 s and is held; at least its window."""
ADVISED_AT = 3
"""Repetition of a task after which advice is given, once."""
STALE = 100
"""Tasks of other names after which a task no longer runs; ``segment`` recognises fewer that take turns."""
RESTS = 512
"""Rests stored, to find those that follow a task."""
ODD = 3.0
"""Smallest unexplained energy of a task that raises an alarm, in standard deviations …"""
CONFIRM = Patience(3)
"""… in this number of consecutive tasks."""


class EnergySettings(RobotStageSettings):
    """Splits the energy of every task by consumer, with the arm's parameters from ``cellwatt disaggregate``."""

    robot: Path
    """robot.yaml, or its folder; relative to the cell's file."""
    balance: Path
    """energy.json of ``cellwatt disaggregate``; relative to the cell's file."""
    arm: str | None = None
    """Source with the joints; not needed if only one source has joints."""
    power: str = "supply.power"
    """Channel of the power of the whole robot."""
    parts: float | None = Field(default=None, gt=0)
    """Parts made per task; if set, energy per part is reported too."""
    brake_time: Seconds = Field(default=2.0, ge=0)
    """Time needed to apply and release the brakes, for the advice to wait with brakes on."""
    meter_class: Fraction = Field(default=0.001, ge=0, lt=1)
    """Largest error of the power meter according to its maker, as a share of the value; for the uncertainties."""


@dataclass(slots=True)
class _Running:
    """State of a task that runs at present."""

    earlier: list[Task] = field(default_factory=list)
    """Its first repetitions, until advice is given."""
    latest: int = 0
    """Number of its newest repetition among all tasks."""
    advised: bool = False
    not_split: int = 0
    """Repetitions whose energy was not split."""


class EnergyStage(Stage[EnergySettings]):
    """Reports the ``Energy`` of each task, and alarms ``energy_balance``, ``energy_not_split``, ``energy_advice_…``."""

    Settings = EnergySettings
    title = "energy of every task by consumer, and advice to save energy"
    needs = ("segment",)

    def __init__(self, name: str, settings: EnergySettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        try:
            from cellwatt_plugins.energy.drive import MOTOR
            from cellwatt_plugins.energy.electronics import at_campaign
            from cellwatt_plugins.energy.known import load_known
            from cellwatt_plugins.robot import Arm
        except ModuleNotFoundError as error:
            raise ConfigError(
                f"stage {name!r} needs the package {error.name}: pip install 'cellwatt[energy]'"
            ) from error

        self._arm = Arm.load(cell.folder / settings.robot, MOTOR)
        self._known = load_known(cell.folder / settings.balance, self._arm)
        robot = robot_name(cell)
        if robot and robot != self._known.robot:
            raise ModelError(f"{settings.balance}: is of robot {self._known.robot}, the cell's robot is {robot}")
        self._columns = self._find(layout)
        self._source = layout.channels[self._columns[0]].source
        self._blocks: deque[tuple[Nanoseconds, Float]] = deque()
        self._newest = 0
        self._level = at_campaign(self._known)
        self._late = round(self._known.late * 1e9)
        self._early_or_late = max(EARLY_OR_LATE, round(layout.channels[self._columns[-1]].window * 1e9))
        self._waiting: deque[Task] = deque()
        self._rests: deque[Interval] = deque(maxlen=RESTS)
        self._tasks = 0
        self._running: dict[str, _Running] = {}
        self._book = AlarmBook()

    def _find(self, layout: Layout) -> list[int]:
        """Columns of positions, velocities, torques and power. Raises ``ConfigError``."""
        from cellwatt_plugins.energy.drive import effort

        columns: list[int] = []
        own = {c.short for c in layout.channels if self.settings.arm in (None, c.source)}
        given, self._gain = effort(own, self._arm)
        units = {"position": "rad", "velocity": "rad/s", "torque": "Nm", "current": "A"}
        for quantity in ("position", "velocity", given):
            found = layout.joints(quantity, self.settings.arm)
            if len(found) != self._arm.joints:
                raise ConfigError(
                    f"stage {self.name!r}: {len(found)} channels joint_….{quantity}, "
                    f"the robot has {self._arm.joints} joints"
                )
            unit = self._arm.description.unit
            columns += [layout.index(layout.names[c], unit(i, units[quantity])) for i, c in enumerate(found)]
        return [*columns, layout.index(self.settings.power, "W")]

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """Return the energy of tasks that ended, and the alarms that changed."""
        if len(frames):
            self._blocks.append((frames.time, frames.values[:, self._columns]))
            self._newest = int(frames.time[-1])
            while self._blocks[0][0][-1] <= self._newest - LONGEST:
                self._blocks.popleft()
        out = self._due()
        for result in upstream:
            if isinstance(result, Interval) and result.source == self._source:
                if result.closed and not result.moving:
                    self._rests.append(result)
                    self._follow(result)
            elif isinstance(result, Task) and result.source == self._source:
                self._waiting.append(result)
                out += self._due()
        return out

    def close(self) -> Sequence[Result]:
        """Return the energy of all waiting tasks, whose late power will not arrive."""
        return self._due(all_of_them=True)

    def _due(self, *, all_of_them: bool = False) -> list[Result]:
        """Split the tasks whose power has arrived."""
        out: list[Result] = []
        wanted = self._late + self._early_or_late
        while self._waiting and (all_of_them or self._newest >= self._waiting[0].end + wanted):
            out += self._split(self._waiting.popleft())
        return out

    def _between(self, start: int, end: int) -> tuple[Nanoseconds, Float]:
        """Times (N,) ns and values of the stored frames from ``start`` to before ``end``, ns."""
        newest_first = [*takewhile(lambda block: block[0][-1] >= start, reversed(self._blocks))]
        times, values = zip(*(newest_first or [self._blocks[-1]])[::-1], strict=True)
        time = np.concatenate(times)
        part = slice(*np.searchsorted(time, [start, end]))
        return time[part], np.concatenate(values)[part]

    def _stretch(self, start: int, end: int, late: int = 0) -> Stretch | str:
        """Frames from ``start`` to ``end`` (ns); the reason if too many are missing or the meter shows no power.

        Power is taken ``late`` ns later than the other channels.
        """
        from cellwatt_plugins.energy.task_energy import Stretch

        if start < self._newest - LONGEST:
            return f"it began more than {LONGEST // 60_000_000_000} min before it was recognised"
        time, values = self._between(start, end + late)
        expected = (end + late - start) // self.layout.step
        whole = np.isfinite(values).all(axis=1)
        if expected < 3:
            return f"it is shorter than 3 frames ({3e3 / self.layout.rate:g} ms)"
        if whole.sum() < (1 - MISSING) * expected:
            return self._gap(expected, values)
        if values[whole, -1].sum() <= 0:
            return f"{self.settings.power} shows no power"
        grid = np.arange(start, end, self.layout.step)
        times = time[whole]
        *joints, power = values[whole].T
        filled = np.stack([np.interp(grid, times, column) for column in joints], axis=1)
        n = self._arm.joints
        step = self.layout.step * 1e-9
        torque = filled[:, 2 * n :] * self._gain
        return Stretch(step, filled[:, :n], filled[:, n : 2 * n], torque, np.interp(grid + late, times, power))

    def _gap(self, expected: int, values: Float) -> str:
        """Reason why a task's frames with ``values`` do not suffice: how many are missing, and of which channel."""
        empty = np.isnan(values).sum(axis=0)
        share = 100 * (1 - int(np.isfinite(values).all(axis=1).sum()) / expected)
        which = self.layout.names[self._columns[int(np.argmax(empty))]]
        most = f", most of {which}" if empty.max() > expected - len(values) else ""
        return f"{share:.1f} % of its frames are missing{most}; up to {100 * MISSING:g} % are interpolated"

    def _follow(self, interval: Interval) -> None:
        """Update the power of the electronics from a rest with brakes released; of a long one, from its end."""
        if interval.end - interval.start < REST:
            return
        start = max(interval.start + self._late, interval.end - FOLLOWED)
        stretch = self._stretch(start, interval.end)
        if isinstance(stretch, str):
            return
        from cellwatt_plugins.energy.electronics import followed

        torque, power = stretch.torque.mean(axis=0), float(stretch.power.mean())
        self._level = followed(self._level, self._arm, self._known, torque, power)

    def _split(self, task: Task) -> list[Result]:
        """Energy of a task, and its alarms that change."""
        from cellwatt_plugins.energy.task_energy import task_energy

        self._tasks += 1
        running = self._running.setdefault(task.name, _Running())
        running.latest = self._tasks
        out: list[Result] = [*self._withdraw(task.end)]
        due = len(running.earlier) == ADVISED_AT - 1
        if not due:
            running.earlier.append(task)
        stretch = self._stretch(task.start, task.end, self._late)
        if isinstance(stretch, str):
            return [*out, *self._not_split(task, running, stretch)]
        meter = self.settings.meter_class / 3**0.5  # standard deviation of a uniform error within the class
        energy = task_energy(self._arm, self._known, stretch, self._level, self._edge(task), meter)
        out += [self._energy(task, energy), *self._split_again(task, running), *self._balance(task, energy)]
        if due and not running.advised:
            running.advised = True
            out += self._advice(task, running.earlier, stretch)
        return out

    def _edge(self, task: Task) -> float:
        """Change of a task's total, J, if power is earlier or later than usual."""
        shifts = (self._late - self._early_or_late, self._late + self._early_or_late)
        grid = np.arange(task.start, task.end, self.layout.step)
        time, values = self._between(task.start + shifts[0], task.end + shifts[1])
        there = np.isfinite(values[:, -1])
        time, power = time[there], values[there, -1]
        early, late = (float(np.interp(grid + shift, time, power).sum()) for shift in shifts)
        return abs(late - early) / 2 * self.layout.step * 1e-9

    def _withdraw(self, now: int) -> list[Alarm]:
        """Forget tasks that no longer run, and withdraw their alarms."""
        gone = [name for name, running in self._running.items() if self._tasks - running.latest >= STALE]
        out: list[Alarm] = []
        for name in gone:
            del self._running[name]
            text = f"Withdrawn: {name} was none of the last {STALE} tasks"
            for alarm_id in [known for known in self._book if known.endswith(f"/{name}")]:
                out += self._book.clear(alarm_id, now, text)
        return out

    def _not_split(self, task: Task, running: _Running, reason: str) -> list[Alarm]:
        """Report that the energy of a task is not split, and why."""
        running.not_split += 1
        evidence: dict[str, float] = {"repetition": task.repetition, "not_split": running.not_split}
        text = f"The energy of {task.name} is not split: {reason}"
        return self._book.raise_(self._alarm("energy_not_split", "info", task, text, evidence))

    def _split_again(self, task: Task, running: _Running) -> list[Alarm]:
        text = f"Resolved: the energy of {task.name} is split again"
        evidence = {"repetition": task.repetition, "not_split": running.not_split}
        return self._book.clear(self._id("energy_not_split", task), task.end, text, evidence=evidence)

    def _energy(self, task: Task, energy: TaskEnergy) -> Energy:
        from cellwatt_plugins.energy.spread import deviations

        parts = self.settings.parts
        return Energy(
            source=task.source,
            task=task.name,
            variant=task.variant,
            repetition=task.repetition,
            start=task.start,
            end=task.end,
            total=energy.total,
            groups=energy.groups,
            uncertainty=energy.uncertainty,
            positive_mechanical=energy.positive_mechanical,
            motion_efficiency_percent=energy.motion_efficiency_percent,
            total_per_part=None if parts is None else energy.total / parts,
            group_uncertainty=deviations(energy.covariance),
        )

    def _balance(self, task: Task, energy: TaskEnergy) -> list[Alarm]:
        """Raise or clear ``energy_balance``: too much energy is in no group."""
        unexplained = energy.groups["unexplained"]
        evidence = {"unexplained_J": unexplained, "uncertainty_J": energy.uncertainty, "total_J": energy.total}
        share = 100 * unexplained / energy.total
        text = f"{task.name}: {share:+.1f} % of its energy is unexplained"
        alarm = self._alarm("energy_balance", "warning", task, text, evidence)
        if abs(unexplained) > ODD * energy.uncertainty:
            return self._book.raise_(alarm, after=CONFIRM, update=False)
        text = f"Resolved: the energy of {task.name} is explained again"
        return self._book.clear(alarm.id, task.end, text, evidence=evidence)

    def _advice(self, task: Task, earlier: Sequence[Task], stretch: Stretch) -> list[Alarm]:
        """Advice for a task; the arm waits after it for the shortest rest that followed the ``earlier`` ones.

        Other tasks may run between two repetitions, and production may pause.
        """
        from cellwatt_plugins.energy.advice import Cycle, advise

        rests = sorted(map(self._rest_after, earlier), key=lambda rest: rest[1] - rest[0])
        waiting = (rests[0][1] - rests[0][0]) * 1e-9
        # Frames of the shortest rest, and of the first part of a long one, may be discarded already: other frames show
        # as well what the arm draws at rest.
        stored = (self._stretch(max(start, self._newest - LONGEST), end) for start, end in rests)
        held = (rest for rest in stored if not isinstance(rest, str))
        cycle = Cycle(stretch, waiting, next(held, None))
        # The power of the electronics is the present one, as in the split.
        drive = replace(self._known.drive, fixed=self._known.drive.fixed + self._level.drift)
        out: list[Alarm] = []
        for advice in advise(self._arm, replace(self._known, drive=drive), cycle, self.settings.brake_time):
            text = f"{task.name}: {advice.statement} (±{advice.uncertainty:.0f} J)"
            evidence = {"saving_J": advice.saving, "uncertainty_J": advice.uncertainty, **advice.setting}
            out += self._book.raise_(self._alarm(f"energy_advice_{advice.kind}", "info", task, text, evidence))
        return out

    def _rest_after(self, task: Task) -> tuple[int, int]:
        """Start and end, ns, of the rest that follows a task before any other motion; equal if there is none."""
        after = (rest for rest in self._rests if rest.number == task.intervals[-1] + 1)
        return next(((rest.start, rest.end) for rest in after), (task.end, task.end))

    def _alarm(self, kind: str, severity: Severity, task: Task, text: str, evidence: dict[str, float]) -> Alarm:
        name, source = self._id(kind, task), self._source
        return Alarm(name, kind, severity, True, task.start, task.end, text, source, evidence=evidence)

    def _id(self, kind: str, task: Task) -> str:
        return f"{self.name}/{kind}/{task.name}"
