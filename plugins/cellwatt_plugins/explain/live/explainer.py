"""Schedule of explanations: when one starts, on which stretch, and which alarms result."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from cellwatt.alarms import AlarmBook
from cellwatt.errors import RecordingError
from cellwatt.results import Alarm
from cellwatt_plugins.explain.live.alarms import Known, Occasion, failed, found
from cellwatt_plugins.explain.live.explanation import RECORDING, ROBOT, SIMULATION, Explanation, Outcome, new_folder
from cellwatt_plugins.explain.live.history import History
from cellwatt_plugins.explain.live.intake import Intake
from cellwatt_plugins.explain.live.recording import write_recording, write_robot, write_simulation
from cellwatt_plugins.explain.live.settings import ExplainSettings
from cellwatt_plugins.explain.live.watch import ChannelWatch
from cellwatt_plugins.robot import RobotDescription


@dataclass
class Explainer:
    """Explains one arm, one explanation at a time.

    ``streamed``: the simulation is a source of the cell, and its torques are compared. ``servos``: the MJCF whose
    servos' law replaces measured torque.

    Whether an explanation is due depends on the frames alone. When it finishes depends on the PC: a replay does not
    reproduce these alarms at the same time.
    """

    prefix: str
    cell: str
    settings: ExplainSettings
    intake: Intake
    robot: RobotDescription
    known: Known
    streamed: bool = False
    servos: Path | None = None
    _running: Explanation | None = None
    _occasion: Occasion | None = None
    _started: int | None = None
    _failures: int = 0
    _book: AlarmBook = field(default_factory=AlarmBook)

    def step(self, now: int, watch: ChannelWatch, history: History) -> list[Alarm]:
        """Alarms that change at ``now`` ns: start a due explanation, report a finished one, clear resolved alarms."""
        out = []
        if not watch.outside and self._running is None:
            out = self._clear(now, "Resolved: recording and simulation agree again")
        if self._running is not None and (outcome := self._running.poll()) is not None:
            self._running = None
            out += self._report(now, outcome)
        if self._due(now, watch):
            out += self._begin(now, watch.since, history)
        return out

    def stop(self) -> None:
        """Stop the running explanation."""
        if self._running is not None:
            self._running.stop()
            self._running = None

    def _due(self, now: int, watch: ChannelWatch) -> bool:
        if self._running is not None or watch.outside < self.settings.after:
            return False
        return self._started is None or now >= self._started + round(self.settings.every * 1e9)

    def _begin(self, now: int, since: int, history: History) -> list[Alarm]:
        time, rows = history.between(max(since, now - round(self.settings.recording * 1e9)), now)
        if not len(time):  # no frames were compared in that time: the explanation stays due
            return []
        self._started = now
        self._occasion = Occasion(self.prefix, self.intake.source, since, now, (int(time[-1]) - int(time[0])) * 1e-9)
        try:
            folder = new_folder(self.settings.folder or Path(), self._name(now), self.settings.keep)
            write_recording(folder / RECORDING, self.intake, time, rows)
            write_robot(folder / ROBOT, self.robot)
            simulation = self.servos
            if self.streamed:
                simulation = folder / SIMULATION
                write_simulation(simulation, self.intake, time, rows)
            self._running = Explanation(folder, simulation, self.settings.limit, self.settings.memory)
            self._occasion = replace(self._occasion, gives_way=self._running.gives_way)
        except RecordingError as error:
            return self._failed(now, str(error))
        return []

    def _name(self, now: int) -> str:
        return f"{self.cell}-{self.prefix}-{datetime.fromtimestamp(now * 1e-9, UTC):%Y%m%dT%H%M%SZ}"

    def _report(self, now: int, outcome: Outcome) -> list[Alarm]:
        if outcome.findings is None:
            return self._failed(now, outcome.failure)
        occasion = self._at(now)
        self._failures = 0
        alarm = found(occasion, outcome, self.known)
        over = self._clear(now, "Resolved: the difference was explained", but=alarm.id)
        return [*over, *self._book.raise_(alarm)]

    def _clear(self, now: int, text: str, but: str = "") -> list[Alarm]:
        return [alarm for name in self._book if name != but for alarm in self._book.clear(name, now, text)]

    def _failed(self, now: int, reason: str) -> list[Alarm]:
        self._failures += 1
        return self._book.raise_(failed(self._at(now), reason, self._failures))

    def _at(self, now: int) -> Occasion:
        assert self._occasion is not None
        return replace(self._occasion, time=now)
