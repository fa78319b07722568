"""Runs stages in order, each isolated: a stage that fails is created again, the others continue."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from cellwatt.alarms import AlarmBook, withdrawn
from cellwatt.errors import CellwattError
from cellwatt.frames import Frames
from cellwatt.record import messages
from cellwatt.results import Alarm, Result
from cellwatt.runtime.allowance import one_line
from cellwatt.stage import Stage

log = logging.getLogger(__name__)

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 60.0  # s of frames
BEGINS_ANEW: Final = "restarts"
"""Reason given when the alarms of a failed or replaced stage are withdrawn."""


@dataclass(slots=True)
class _Slot:
    """One stage, its state and its figures."""

    name: str
    make: Callable[[], Stage[Any]]
    stage: Stage[Any]
    failures: int = 0
    error: str | None = None
    again_at: int = 0
    frames: int = 0
    results: int = 0
    busy: float = 0.0
    slowest: float = 0.0
    alarms: AlarmBook = field(default_factory=AlarmBook)

    def named(self, results: Sequence[Result]) -> Sequence[Result]:
        """Set the stage's name in the alarms among ``results``, and note these alarms.

        Raises ``ValueError`` or ``KeyError`` for a result that the processes which read it could not decode.
        """
        for result in results:
            messages.decode(type(result), messages.encode(result))
        if not any(isinstance(result, Alarm) for result in results):
            return results
        named = [replace(r, stage=self.name) if isinstance(r, Alarm) else r for r in results]
        for alarm in named:
            if isinstance(alarm, Alarm):
                self.alarms.take(alarm)
        return named

    def take_back(self, time: int) -> list[Result]:
        """Clears, at ``time`` ns, for the active alarms of the stage: its successor does not know them."""
        before, self.alarms = self.alarms, AlarmBook()
        return [*withdrawn((standing.alarm for standing in before.raised), time, BEGINS_ANEW)]


def group_by_needs(stages: Mapping[str, type[Stage[Any]]], kinds: Mapping[str, str]) -> list[list[str]]:
    """Names of stages in groups that share no results, each ordered so that a stage follows those it needs.

    ``kinds`` maps a stage's name to its kind; a stage needs every stage of the kinds in its ``needs``.
    """
    needed = {n: [m for m in stages if kinds[m] in stages[n].needs and m != n] for n in stages}
    ordered: list[str] = []

    def visit(name: str, path: tuple[str, ...]) -> None:
        if name in path:
            raise CellwattError(f"stages need each other in a circle: {' → '.join((*path, name))}")
        if name not in ordered:
            for other in needed[name]:
                visit(other, (*path, name))
            ordered.append(name)

    for name in stages:
        visit(name, ())
    groups: list[list[str]] = []
    for name in ordered:
        linked = [g for g in groups if any(m in g for m in needed[name])]
        merged = [m for g in linked for m in g] + [name]
        groups = [g for g in groups if g not in linked] + [merged]
    return groups


class Chain:
    """Stages that pass results to each other, run one after another on each block of frames.

    Replay and the offline commands call it directly, the daemon in a process of its own.
    """

    def __init__(self, makers: Mapping[str, Callable[[], Stage[Any]]], stages: Mapping[str, Stage[Any]]) -> None:
        self._slots = [_Slot(n, makers[n], s) for n, s in stages.items()]
        self.names = tuple(stages)

    @property
    def stages(self) -> dict[str, Stage[Any]]:
        """The stages by name, in running order."""
        return {slot.name: slot.stage for slot in self._slots}

    def process(self, frames: Frames) -> list[Result]:
        """Results of all stages for one block, in stage order."""
        results: list[Result] = []
        for slot in self._slots:
            results += self._guard(slot, frames, results)
        return results

    def close(self) -> list[Result]:
        """Results that the end of the data completes, in stage order."""
        results: list[Result] = []
        for slot in self._slots:
            try:
                results += slot.named(slot.stage.close())
            except Exception as error:
                log.exception("stage %s failed at the end of the data", slot.name)
                slot.error = str(error)
        return results

    def take_back(self, time: int) -> list[Result]:
        """Clears for all alarms of the stages, because successors replace them."""
        return [clear for slot in self._slots for clear in slot.take_back(time)]

    def _guard(self, slot: _Slot, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        now = int(frames.time[-1])
        if slot.error is not None and not self._revive(slot, now):
            return ()
        start = time.perf_counter()
        try:
            given = slot.named(slot.stage.process(frames, upstream if slot.stage.needs else ()))
        except Exception as error:
            log.exception("stage %s failed; it is created again", slot.name)
            self._fail(slot, error, now)
            return slot.take_back(now)
        spent = time.perf_counter() - start
        slot.frames += len(frames)
        slot.results += len(given)
        slot.busy += spent
        slot.slowest = max(slot.slowest, spent)
        return given

    def _fail(self, slot: _Slot, error: Exception, now: int) -> None:
        slot.failures += 1
        slot.error = one_line(f"{type(error).__name__}: {error}")
        pause = min(FIRST_PAUSE * 2 ** min(slot.failures - 1, 10), LONGEST_PAUSE)
        slot.again_at = now + round(pause * 1e9)

    def _revive(self, slot: _Slot, now: int) -> bool:
        if now < slot.again_at:
            return False
        try:
            slot.stage = slot.make()
        except Exception as error:
            log.warning("stage %s cannot be created again: %s", slot.name, error)
            self._fail(slot, error, now)
            return False
        slot.error = None
        return True

    def status(self) -> dict[str, Any]:
        """Figures of each stage for health, JSON-ready."""
        return {
            s.name: {
                "state": "broken" if s.error else "ok",
                "error": s.error,
                "failures": s.failures,
                "frames": s.frames,
                "results": s.results,
                "mean_us_per_frame": round(1e6 * s.busy / s.frames, 1) if s.frames else None,
                "slowest_ms": round(1e3 * s.slowest, 3),
            }
            for s in self._slots
        }
