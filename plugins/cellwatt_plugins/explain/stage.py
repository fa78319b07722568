"""The live side of ``explain``: consumes frames and intervals, publishes the simulation's predictions and alarms.

Pinocchio and scipy are imported when a stage is created, not when its settings are read.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt.files import Place
from cellwatt.frames import Frames, Layout
from cellwatt.results import Alarm, Interval, Prediction, Result
from cellwatt.stage import CellInfo, Stage
from cellwatt_plugins.explain.live.alarms import Occasion, left_out
from cellwatt_plugins.explain.live.band import Band
from cellwatt_plugins.explain.live.history import History
from cellwatt_plugins.explain.live.intake import intake, streamed
from cellwatt_plugins.explain.live.motions import Motions
from cellwatt_plugins.explain.live.settings import MismatchSettings
from cellwatt_plugins.explain.live.watch import ChannelWatch
from cellwatt_plugins.explain.live.window import Stretch, Window, bridged

LONGEST = 120.0
"""Longest part of an interval that is judged, in s before its end."""
COVERED = 0.8
"""Smallest share of an interval's frames that must have been compared for it to be judged."""
WAITING = 64
"""Largest number of intervals that wait for their frames to be simulated."""


class MismatchStage(Stage[MismatchSettings]):
    """Publishes a ``Prediction`` of torques and power each second, and alarms.

    ``simulation_differs`` for a channel outside its band, ``mismatch`` for its explanation, ``explanation_failed``
    where no explanation could be computed, ``effect_not_followed`` for effects of a model that a daemon cannot
    simulate.
    """

    Settings = MismatchSettings
    title = "where and since when a simulation and the recording differ, and the physics that explains it"
    needs = ("segment",)

    def __init__(self, name: str, settings: MismatchSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        try:
            from cellwatt_plugins.explain.live.explainer import Explainer
            from cellwatt_plugins.explain.live.simulation import Simulation, open_model, servos
        except ImportError as error:
            raise ConfigError(
                f"stage {name!r} needs the package {error.name}: pip install 'cellwatt[explain]'"
            ) from error
        streams = any(channel.source == settings.simulation for channel in layout.channels)
        robot, joints = _robot(settings, cell), len(layout.joints("position", settings.arm))
        model = open_model("robot" if streams else settings.simulation, robot, cell.folder, joints)
        self._intake = intake(layout, settings.arm, settings.power, model.robot)
        self._streamed = streamed(settings.simulation, layout, self._intake)
        places = self._intake.places
        hold = settings.command_rate and 1 / settings.command_rate
        file, servo = servos(robot, model) if self._intake.driven else (None, None)
        self._simulation = Simulation(model, layout.step * 1e-9, "temperature" in places, servo, hold)
        needed = [places[q] for q in ("position", "velocity", "command") if q in places]
        motion = [column for place in needed for column in range(place.start, place.stop)]
        self._window = Window(motion, layout.step, self._simulation.lead)
        self._width = max(place.stop for place in places.values())
        keep = max(LONGEST, settings.explain.recording if settings.explain else 0.0)
        self._history = History(round(keep * layout.rate), self._width + len(self._intake.judged))
        self._motions = Motions()
        self._band = Band(settings.band, self._intake.judged, layout.step * 1e-9)
        self._watch = ChannelWatch(name, self._intake.source, settings.band.confirm)
        self._intervals: deque[Interval] = deque(maxlen=WAITING)
        self._explainer: Explainer | None = None
        if settings.explain is not None:
            folder = (cell.folder / settings.explain.folder) if settings.explain.folder else Path("mismatch")
            explained = settings.explain.model_copy(update={"folder": Path(folder).absolute()})
            parts = (self._intake, self._simulation.model.robot, self._simulation.known)
            self._explainer = Explainer(name, cell.cell, explained, *parts, self._streamed is not None, file)
        self._unreported = self._simulation.left_out
        self.counts: Counter[str] = Counter()

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """Return the predictions that are complete with this block, and the alarms that changed."""
        ours = (r for r in upstream if isinstance(r, Interval) and r.source == self._intake.source)
        self._intervals.extend(r for r in ours if r.closed and r.complete and r.moving)
        if not len(frames):
            return ()
        out: list[Result] = self._report_once(int(frames.time[0]))
        sequence = frames.sequence + np.arange(len(frames))
        rows = self._intake.rows(frames)
        if self._streamed is not None:
            rows = np.column_stack([rows, frames.values[:, self._streamed]])
        for stretches in self._window.feed(frames.time, sequence, rows):
            out += map(self._compare, stretches)
            out += self._judge()
        out += self._judge()
        if self._explainer is not None:
            out += self._explainer.step(int(frames.time[-1]), self._watch, self._history)
        return out

    def close(self) -> Sequence[Result]:
        """Stop a running explanation."""
        if self._explainer is not None:
            self._explainer.stop()
        return ()

    def _report_once(self, now: int) -> list[Result]:
        names, self._unreported = self._unreported, ()
        return [left_out(Occasion(self.name, self._intake.source, now, now), names)] if names else []

    def _compare(self, stretch: Stretch) -> Prediction:
        """Simulate a stretch, and store its new frames in the history: measured beside simulated values."""
        places, new = self._intake.places, stretch.new
        simulated, driven = self._simulated(stretch)
        simulated, measured = simulated[new], stretch.values[new, : self._width]
        if driven is not None:
            measured[:, places["command"]], measured[:, places["torque"]] = (each[new] for each in driven)
        read = np.isfinite(measured[:, places[self._intake.measured]])
        known = ~stretch.bridged[new] & np.isfinite(simulated).all(axis=1)
        # A dead sensor of one joint does not hide the other joints.
        usable = known & read.any(axis=1)
        self._history.add(stretch.time[new][usable], np.column_stack([measured, simulated])[usable])
        self.counts["compared"] += int(usable.sum())
        self.counts["torque missing"] += int(np.sum(~(known & read.all(axis=1)) & ~stretch.bridged[new]))
        simulated[stretch.bridged[new]] = np.nan
        judged = self._intake.judged
        return Prediction(
            model=self.name,
            sequence=int(stretch.sequence[new.start]),
            time=tuple(stretch.time[new].tolist()),
            outputs={c.name: tuple(simulated[:, i].tolist()) for i, c in enumerate(judged)},
            units={c.name: c.unit for c in judged},
        )

    def _simulated(self, stretch: Stretch) -> tuple[Float, tuple[Float, Float] | None]:
        """Simulated values (N, C) for all frames of a stretch; commands and torques (N, n) Nm of driven servos."""
        if self._streamed is not None:
            return stretch.values[:, self._width :], None
        places = self._intake.places
        velocity, command, temperature = (
            stretch.values[:, places[q]] if q in places else None for q in ("velocity", "command", "temperature")
        )
        if temperature is not None:
            known = np.isfinite(temperature).any(axis=0).all()
            temperature = bridged(temperature, range(temperature.shape[1])) if known else None
        time = (stretch.time - stretch.time[0]) * 1e-9
        predicted, driven = self._simulation.run(
            time, stretch.values[:, places["position"]], velocity, temperature, command
        )
        parts = [predicted.torque] if self._intake.power is None else [predicted.torque, predicted.power[:, None]]
        return np.column_stack(parts), driven

    def _judge(self) -> list[Alarm]:
        """Alarms that change with the intervals whose frames have all been simulated."""
        out: list[Alarm] = []
        while self._intervals and self._intervals[0].end <= self._window.settled:
            interval = self._intervals.popleft()
            start = max(interval.start, interval.end - round(LONGEST * 1e9))
            time, rows = self._history.between(start, interval.end)
            if len(time) < max(8, COVERED * (interval.end - start) / self.layout.step):
                self.counts["intervals not covered"] += 1
                continue
            readings = self._band.read(interval.moving, rows[:, self._judged], rows[:, self._width :])
            alarms = self._watch.take(self._motions.number(interval), interval, readings)
            out += map(self._with_counts, alarms)
            self.counts["intervals judged"] += bool(readings)
        return out

    def _with_counts(self, alarm: Alarm) -> Alarm:
        counts = {
            "frames_compared": self.counts["compared"],
            "frames_missing": self._window.counts["missing"] + self.counts["torque missing"],
            "frames_beside_gaps": self._window.counts["edge"],
        }
        return replace(alarm, evidence={**alarm.evidence, **counts})

    @property
    def _judged(self) -> list[int]:
        """Columns of the history with the measured values that are compared."""
        places = self._intake.places
        torque = places[self._intake.measured]
        return [*range(torque.start, torque.stop), *([places["power"].start] if "power" in places else [])]


def _robot(settings: MismatchSettings, cell: CellInfo) -> Place | None:
    """Path of the robot description."""
    if settings.robot is not None:
        return cell.folder / settings.robot
    if cell.robot is None:
        return None
    beside = cell.folder / cell.robot
    return beside if beside.exists() else cell.robot
