"""Read recordings and simulations, with the robot's description, into runs on even time grids."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from cellwatt.arrays import Float, rows_of
from cellwatt.errors import RecordingError
from cellwatt.progress import steps
from cellwatt.scheduler import spread
from cellwatt_plugins.explain.input.alignment import LATE, SAME, delay
from cellwatt_plugins.explain.input.driven import driven
from cellwatt_plugins.explain.input.factors import joints_text
from cellwatt_plugins.explain.input.grid import with_sides
from cellwatt_plugins.explain.input.moved import moved
from cellwatt_plugins.explain.input.run import Run, Simulated
from cellwatt_plugins.explain.input.signals import Signals, motor_torque, read_signals
from cellwatt_plugins.explain.input.sources import Source, run_name
from cellwatt_plugins.explain.input.unread import without_unread
from cellwatt_plugins.explain.simulators import Simulator, load_simulator
from cellwatt_plugins.explain.simulators.mujoco import Actuators
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.meter.file import power_beside
from cellwatt_plugins.robot.motion import Moved, Plan, exact
from cellwatt_plugins.robot.samples import EFFORTS, interpolated

SAME_CLOCK = 0.5
"""Least overlap of recording and simulation, as a share of the shorter one; with less, their clocks differ."""
RATE, SAMPLES = 250.0, 100_000
"""Largest number of samples per second, and in all: joints ring below 50 Hz, faster signals come from the drives. Long
recordings are averaged to a lower rate, which is enough for slow effects."""
COVERED = 0.5
"""Share of a recording that its simulation must cover."""


def read_sources(
    files: Sequence[Source], robot: RobotDescription, simulator: Path | None = None, fastest: float = RATE
) -> list[Run]:
    """Read the files as runs of ``fastest`` Hz or less; a run has a plan if it has a simulation or target columns.

    Recordings so long that they are averaged are divided at their pauses, which do not count as length. A simulator's
    own file (MJCF, URDF) is run on each recording. Raises ``RecordingError`` if a file cannot be used, ``ConfigError``
    if the description lacks a number that is needed.
    """
    read = spread(read_source, files, "reading recordings", shared=robot)
    parts = [[each] for each in read]
    if any(each.step * SAMPLES < seconds(read) for each in read):
        parts = [each.parts() for each in read]
    rate = min(fastest, SAMPLES / seconds(chain.from_iterable(parts)))
    slowed = [
        (file if len(own) == 1 else replace(file, name=f"{file.name} (part {i})"), part.slower(rate))
        for file, own in zip(files, parts, strict=True)
        for i, part in enumerate(own, start=1)
    ]
    loaded = None if simulator is None else load_simulator(simulator, robot.names)
    drives = loaded.actuators() if loaded is not None and loaded.model.nu else None
    runs = spread(_prepared, slowed, "preparing runs", shared=(robot, drives))
    if loaded is None:
        return runs
    return [_run_through(loaded, run) for run in steps(driven(runs, loaded), "simulating run")]


def seconds(every: Iterable[Signals]) -> float:
    """Length of some recordings, s, with what was filled in."""
    return sum(float(signals.time[-1] - signals.time[0]) for signals in every)


def _prepared(entry: tuple[Source, Signals], known: tuple[RobotDescription, Actuators | None]) -> Run:
    """Make a run from its source and its signals; ``known``: the robot, and a simulator's actuators."""
    (source, signals), (robot, drives) = entry, known
    signals = signals.with_controls(drives)
    effort = EFFORTS.keys() & signals.joints.keys()
    run = without_unread(
        Run(
            name=source.name,
            time=signals.time,
            position=signals.needed("position"),
            velocity=signals.joints.get("velocity"),
            torque=motor_torque(signals, robot),
            power=signals.power,
            temperature=signals.joints.get("temperature"),
            command=signals.joints.get("command"),
            exact_times=signals.exact_times,
            gaps=with_sides(signals.gaps, signals.step),
            averaged=signals.averaged,
            torque_from="torque" if "torque" in signals.joints or not effort else "current",
            notes=signals.notes,
        )
    )
    if source.simulation is not None:
        simulated = read_signals(source.simulation, robot).with_controls(None)
        return _with_simulation(replace(run, notes=(*run.notes, *simulated.notes)), simulated)
    return _with_targets(run, signals) if "target_position" in signals.joints else run


def read_source(source: Source, robot: RobotDescription) -> Signals:
    """Read a recording, with the power of its meter's own file if it has one. Raises ``RecordingError``."""
    signals = read_signals(source.recording, robot)
    if source.meter is None:
        return signals
    return replace(signals, power=power_beside(source.meter, signals.time, signals.needed("position")))


def _run_through(simulator: Simulator, run: Run) -> Run:
    """The run with a simulator's torque for the planned motion, or for the measured motion if there is no plan."""
    plan = Plan(*moved(run).courses) if run.plan is None else run.plan
    # If only motion was recorded, friction is not assumed to reverse early as it does in the simulator.
    torque = simulator.torque(*plan.courses, leading=run.drive is None)
    notes = [note for note in simulator.notes if note not in run.notes]
    return replace(run, simulated=Simulated(run.time, plan, torque), notes=(*run.notes, *notes))


def read_motion(path: Path, simulation: Path | None, robot: RobotDescription) -> tuple[Run, Moved | None]:
    """Read a motion to be simulated: a run without torque, and the exact motion if it was planned, not measured.

    A file with accelerations counts as planned. ``simulation`` is the user's simulation of the motion. Raises
    ``RecordingError``.
    """
    signals = read_signals(path, robot)
    position, velocity = signals.needed("position"), signals.joints.get("velocity")
    temperature = signals.joints.get("temperature")
    run = Run(run_name(path), signals.time, position, velocity, np.zeros_like(position), temperature=temperature)
    if simulation is not None:
        run = _with_simulation(run, read_signals(simulation, robot).with_controls(None), cut=False)
    if "acceleration" not in signals.joints:
        return run, None
    return replace(run, plan=None), exact(position, *signals.derivatives("position", "velocity", "acceleration"))


def _with_simulation(run: Run, simulation: Signals, cut: bool = True) -> Run:
    """The run with its simulation; both are assumed to begin together if neither clocks nor motions can be aligned."""
    planned = _planned(simulation, "" if "position" in simulation.joints else "target_")
    when, note = simulation.time, ""
    own = np.arange(when[0], when[-1], run.step)
    late, error = delay(run.position, interpolated(own, when, planned.position))
    shift = float(run.time[0] - when[0])
    shared = min(when[-1], run.time[-1]) - max(when[0], run.time[0])
    apart = shared < SAME_CLOCK * min(when[-1] - when[0], run.time[-1] - run.time[0])
    if error < SAME and (apart or abs(shift + late * run.step) > LATE):
        shift, how = shift + late * run.step, "aligned by their motion"
    elif apart:
        how = "assumed to begin together"
    else:
        shift = 0.0
    if shift:
        when, note = when + shift, f"recording and simulation have different clocks ({shift:.3f} s apart), {how}"
    run = _with_plan(run, simulation, when, planned, note, cut)
    torque = simulation.joints.get("torque")
    if torque is not None and not np.isfinite(torque).all():
        silent = joints_text((1 + np.flatnonzero(np.isnan(torque).any(axis=0))).tolist())
        raise RecordingError(f"{simulation.place}: no torque of {silent}: a simulation needs the torque of every joint")
    return replace(run, simulated=None if torque is None else Simulated(when, planned, torque, simulation.power))


def _with_targets(run: Run, signals: Signals) -> Run:
    """The run with its target columns as plan, delayed if the controller logs targets long before they are reached."""
    planned = _planned(signals, "target_")
    samples, error = delay(run.position, planned.position)
    late = samples * run.step
    if abs(late) <= LATE or error > SAME:
        return _with_plan(run, signals, signals.time, planned)
    note = f"the target columns are {late:.2f} s ahead of the motion and were delayed by that"
    return _with_plan(run, signals, signals.time + late, planned, note)


def _with_plan(run: Run, source: Signals, when: Float, planned: Plan, note: str = "", cut: bool = True) -> Run:
    """The run, cut to the time that a plan at ``when`` (M,) s covers, with the plan resampled to the run's time grid.

    Raises ``RecordingError`` if the plan covers too little of the recording.
    """
    slack = 0.51 * max(run.step, source.step)
    covered = (run.time >= when[0] - slack) & (run.time <= when[-1] + slack)
    if np.mean(covered) < COVERED:
        raise RecordingError(
            f"{run.name}: its simulation {source.place} spans {when[0]:.2f} to {when[-1]:.2f} s, the recording "
            f"{run.time[0]:.2f} to {run.time[-1]:.2f} s: is it the simulation of this run?"
        )
    if cut:
        run = _cut(run, slice(int(np.argmax(covered)), len(covered) - int(np.argmax(covered[::-1]))))
    gaps = (np.interp(run.time, when, source.gaps) > 0) | run.filled
    time = np.clip(run.time, when[0], when[-1])
    position = CubicHermiteSpline(when, planned.position, planned.velocity)
    velocity = CubicHermiteSpline(when, planned.velocity, planned.acceleration)
    # Linear interpolation errs with the second derivative of the acceleration, which would imitate an elastic joint.
    plan = Plan(np.asarray(position(time)), np.asarray(velocity(time)), np.asarray(velocity.derivative()(time)))
    more = [f"{run.name}: {note}"] if note else []
    return replace(run, plan=plan, gaps=gaps, notes=(*run.notes, *more))


def _cut(run: Run, part: slice) -> Run:
    lost = len(run.time) - (part.stop - part.start)
    if not lost:
        return run
    note = f"{run.name}: {lost * run.step:.2f} s of the recording lie outside its simulation and are left out"
    return replace(rows_of(run, part), notes=(*run.notes, note))


def _planned(signals: Signals, prefix: str) -> Plan:
    """The motion in the columns with a ``prefix``, on the time grid of the file."""
    names = [f"{prefix}{quantity}" for quantity in ("position", "velocity", "acceleration")]
    return Plan(signals.needed(names[0]), *signals.derivatives(*names))
