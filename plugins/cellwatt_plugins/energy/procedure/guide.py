"""Leads an operator through a campaign on the terminal; what is done stays done, and each step can be repeated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from time import time_ns
from typing import Final, Protocol

import numpy as np

from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.procedure.cut import CutRun, cut_programme, cut_states
from cellwatt_plugins.energy.procedure.live import Feed
from cellwatt_plugins.energy.procedure.log import STATES, AtRest, Log, Programme, StateName, read_log, write_log
from cellwatt_plugins.energy.procedure.reading import PATIENCE, WINDOW, take_reading
from cellwatt_plugins.energy.procedure.recorded import Recorded
from cellwatt_plugins.energy.procedure.rest_pose import RestPose
from cellwatt_plugins.robot import Arm

LOG: Final = "campaign.json"


class Terminal(Protocol):
    """Terminal of the operator."""

    def say(self, text: str) -> None:
        """Print a line."""
        ...

    def show(self, text: str) -> None:
        """Print over the line that was shown before."""
        ...

    def ask(self, question: str, answers: str) -> str:
        """One of the letters of ``answers``; the first where only Enter is pressed."""
        ...


@dataclass(frozen=True)
class Plan:
    """Steps of a campaign."""

    arm: Arm
    pose: RestPose
    speeds: tuple[float, ...]
    repetitions: int
    least: int
    window: float = WINDOW
    patience: float = PATIENCE


@dataclass(frozen=True)
class Places:
    """Sources and targets of a campaign's data."""

    feed: Callable[[], AbstractContextManager[Feed]]
    recorded: Callable[[], Recorded]
    """Opens the cell's recording as it is now."""
    out: Path


def guide(plan: Plan, places: Places, terminal: Terminal, again: Sequence[str] = ()) -> Log:
    """All steps that are not done yet, or are to be done ``again``; writes the files that ``disaggregate`` reads.

    Raises ``RecordingError`` where the recording cannot be read or the operator stops.
    """
    log = _begun(plan, places.out / LOG)
    for name in _states(plan.arm):
        if name not in log.states or name in again:
            log = log.with_state(name, _state(plan, places, terminal, name))
            write_log(log, places.out / LOG)
    cut_states(places.recorded(), log, places.out)
    for payload in (0.0, plan.arm.description.payload):
        done = any(programme.payload == payload for programme in log.programmes)
        if not done or f"{payload:g}kg" in again:
            log = log.with_programme(_programme(plan, places, terminal, payload))
            write_log(log, places.out / LOG)
    return log


def _begun(plan: Plan, path: Path) -> Log:
    robot = plan.arm.description.robot
    log = read_log(path) if path.exists() else Log(robot=robot)
    if log.robot != robot:
        raise RecordingError(
            f"{path}: is a campaign of {log.robot}, robot.yaml describes {robot}: choose another --out"
        )
    return log


def _states(arm: Arm) -> list[StateName]:
    """Step 1 of the paper; where arm and controller are one, they are measured as one."""
    skipped = set() if arm.description.controller_separate else {"controller"}
    return [name for name in STATES if name not in skipped]


def _instruction(plan: Plan, name: StateName) -> str:
    if name == "controller":
        return "Switch the controller off, unplug the arm, switch the controller on and wait until it has started."
    if name == "connected":
        return "Arm plugged in, controller on, brakes on: the arm must not be switched on."
    degrees = ", ".join(f"{angle:.1f}" for angle in np.degrees(plan.pose.q))
    released = "brakes released" if plan.arm.description.brakes else "arm switched on"
    return (
        f"Move the arm to the pose of least gravity, joints at {degrees} deg, look that its way is free; {released}, "
        f"no program running. Gravity leaves {plan.pose.residual:.2f} Nm there."
    )


def _state(plan: Plan, places: Places, terminal: Terminal, name: StateName) -> AtRest:
    terminal.say(f"\n{name}: {_instruction(plan, name)}")
    while True:
        if terminal.ask("Press Enter when it is so, q to stop", "yq") == "q":
            raise RecordingError("stopped: what was measured is kept, the same command goes on")
        with places.feed() as feed:
            pose = plan.pose.q if name == "released" else None
            taken = take_reading(feed, terminal.show, plan.window, plan.patience, pose)
        if taken is None:
            terminal.say("no value comes from the analyzer: is it a source of the cell, and is cellwatt running?")
            continue
        reading = taken.reading
        terminal.say(f"{name}: {reading.power:.2f} ± {reading.uncertainty:.3f} W, drift {reading.drift:+.2f} W")
        for objection in taken.objections:
            terminal.say(f"  {objection}")
        default = "ra" if taken.objections else "ar"
        if terminal.ask("a to accept, r to repeat", default) == "a":
            return reading


def _programme(plan: Plan, places: Places, terminal: Terminal, payload: float) -> Programme:
    load = f"Mount {payload:g} kg" if payload else "Take off tool and payload"
    terminal.say(f"\n{payload:g} kg: {load}, tell it to the controller, and load the program of {payload:g} kg.")
    while True:
        if terminal.ask("Press Enter, then start the program; q to stop", "yq") == "q":
            raise RecordingError("stopped: what was measured is kept, the same command goes on")
        start = time_ns()
        terminal.ask("Press Enter when the program has ended", "y")
        programme = Programme(payload=payload, start=start, end=time_ns())
        runs = _cut(plan, places, terminal, programme)
        bad = not runs or any(run.repetitions < run.asked for run in runs)
        if terminal.ask("a to accept, r to repeat", "ra" if bad else "ar") == "a":
            return programme


def _cut(plan: Plan, places: Places, terminal: Terminal, programme: Programme) -> list[CutRun]:
    """Cut what was just recorded, and say what is there."""
    recorded = places.recorded()
    try:
        runs = cut_programme(recorded, plan.arm, programme, plan.speeds, plan.repetitions, plan.least, places.out)
    except RecordingError as error:
        terminal.say(str(error))
        return []
    for run in runs:
        terminal.say(run.in_words())
    return runs
