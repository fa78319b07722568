"""From what the user gives (recordings, simulations, the robot's description) to runs on even time grids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from cellwatt.errors import RecordingError
from cellwatt.progress import steps
from cellwatt.scheduler import spread
from cellwatt_plugins.mismatch.input.alignment import LATE, SAME, delay
from cellwatt_plugins.mismatch.input.driven import driven
from cellwatt_plugins.mismatch.input.factors import joints_text
from cellwatt_plugins.mismatch.input.moved import moved
from cellwatt_plugins.mismatch.input.run import Run, Simulated
from cellwatt_plugins.mismatch.input.signals import Signals, motor_torque, read_signals
from cellwatt_plugins.mismatch.input.sources import Source, run_name, simulator_file, sources
from cellwatt_plugins.mismatch.input.unread import without_unread
from cellwatt_plugins.mismatch.simulators import Simulator, load_simulator
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.meter import power_beside
from cellwatt_plugins.robot.motion import Moved, Plan, exact
from cellwatt_plugins.robot.samples import interpolated

Float = NDArray[np.float64]

SAME_CLOCK = 0.5
"""Recording and simulation that share less of the shorter one have different clocks."""
RATE, SAMPLES = 250.0, 100_000
"""Samples a second that are looked at: joints ring below 50 Hz, and what is faster is the drives' own. Of long
recordings fewer, so that there are not more than so many in all: what is slow needs no more."""
COVERED = 0.5
"""Share of a recording that its simulation must cover."""


def read_runs(
    recordings: Sequence[Path], simulations: Sequence[Path], robot: RobotDescription, meters: Sequence[Path] = ()
) -> list[Run]:
    """The recordings as runs; each with a plan where it has a simulation, or target columns of its own.

    ``sources`` says which files belong together; a simulator's own file (MJCF, URDF) is run on each recording. Raises
    ``RecordingError`` where a file cannot be used, ``ConfigError`` where the description lacks what it needs.
    """
    return read_sources(sources(recordings, simulations, meters), robot, simulator_file(simulations))


def read_sources(files: Sequence[Source], robot: RobotDescription, simulator: Path | None = None) -> list[Run]:
    """The same of files that belong together."""
    every = spread(read_source, files, "reading recordings", shared=robot)
    rate = min(RATE, SAMPLES / sum(float(signals.time[-1] - signals.time[0]) for signals in every))
    slowed = [each.slower(rate) for each in every]
    loaded = None if simulator is None else load_simulator(simulator, [joint.name for joint in robot.joints])
    known = _Known(robot, None if loaded is None else loaded.control_gains())
    runs = spread(_prepared, list(zip(files, slowed, strict=True)), "preparing runs", shared=known)
    if loaded is None:
        return runs
    return [_run_through(loaded, run) for run in steps(driven(runs, loaded), "simulating run")]


def read_one(source: Source, robot: RobotDescription, simulator: Path | None, rate: float) -> Run:
    """One of many recordings as a run of ``rate`` Hz or less. Raises as ``read_runs``."""
    loaded = None if simulator is None else load_simulator(simulator, [joint.name for joint in robot.joints])
    known = _Known(robot, None if loaded is None else loaded.control_gains())
    run = _prepared((source, read_source(source, robot).slower(rate)), known)
    return run if loaded is None else _run_through(loaded, driven([run], loaded)[0])


@dataclass(frozen=True)
class _Known:
    """What the numbers of a recording are read with."""

    robot: RobotDescription
    gains: Float | None
    """(n,) Nm of one unit of a simulator's control; NaN where it is no torque."""


def _prepared(told: tuple[Source, Signals], known: _Known) -> Run:
    """The run of its files and of what was recorded."""
    source, signals = told
    robot = known.robot
    signals = signals.with_controls(known.gains)
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
            gaps=signals.gaps if signals.gaps.any() else None,
            torque_from="current" if "current" in signals.joints and "torque" not in signals.joints else "torque",
            notes=signals.notes,
        )
    )
    if source.simulation is not None:
        simulated = read_signals(source.simulation, robot).with_controls(None)
        return _with_simulation(replace(run, notes=(*run.notes, *simulated.notes)), simulated)
    return _with_targets(run, signals) if "target_position" in signals.joints else run


def read_source(source: Source, robot: RobotDescription) -> Signals:
    """A recording, with the power of its meter's own file where there is one. Raises ``RecordingError``."""
    signals = read_signals(source.recording, robot)
    if source.meter is None:
        return signals
    return replace(signals, power=power_beside(source.meter, signals.time, signals.needed("position")))


def _run_through(simulator: Simulator, run: Run) -> Run:
    """The run with what a simulator says of the motion that was commanded, or made where no command was recorded."""
    if run.plan is None:
        motion = moved(run)
        plan = Plan(motion.position, motion.velocity, motion.acceleration)
    else:
        plan = run.plan
    # How friction turns over is told by motion alone: no simulator's way is taken for the arm's there.
    torque = simulator.torque(plan.position, plan.velocity, plan.acceleration, leading=run.drive is None)
    notes = [note for note in simulator.notes if note not in run.notes]
    return replace(run, simulated=Simulated(run.time, plan, torque), notes=(*run.notes, *notes))


def read_motion(path: Path, simulation: Path | None, robot: RobotDescription) -> tuple[Run, Moved | None]:
    """A motion to simulate as a run without torque, and the motion itself where it is known rather than measured.

    One with accelerations was planned. ``simulation`` is what the user's simulation says of it. Raises
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
    """The run with what its simulation says; both begin together where neither clock nor motion tells."""
    planned = _simulated(simulation)
    when, note = simulation.time, ""
    own = np.arange(when[0], when[-1], run.step)
    late, error = delay(run.position, interpolated(own, when, planned.position))
    shift = float(run.time[0] - when[0])
    shared = min(when[-1], run.time[-1]) - max(when[0], run.time[0])
    apart = shared < SAME_CLOCK * min(when[-1] - when[0], run.time[-1] - run.time[0])
    if error < SAME and (apart or abs(shift + late * run.step) > LATE):
        shift, how = shift + late * run.step, "lined up by their motion"
    elif apart:
        how = "taken to begin together"
    else:
        shift = 0.0
    if shift:
        when, note = when + shift, f"recording and simulation have different clocks ({shift:.3f} s apart), {how}"
    run = _with_plan(run, simulation, when, planned, note, cut)
    torque = simulation.joints.get("torque")
    if torque is not None and not np.isfinite(torque).all():
        silent = joints_text((1 + np.flatnonzero(np.isnan(torque).any(axis=0))).tolist())
        raise RecordingError(f"{simulation.place}: no torque of {silent}: a simulation tells the torque of every joint")
    return replace(run, simulated=None if torque is None else Simulated(when, planned, torque, simulation.power))


def _with_targets(run: Run, signals: Signals) -> Run:
    """The run with the motion that it says was commanded; some controllers log commands long before they are met."""
    planned = _targets(signals)
    samples, error = delay(run.position, planned.position)
    late = samples * run.step
    if abs(late) <= LATE or error > SAME:
        return _with_plan(run, signals, signals.time, planned)
    note = f"the target columns are {late:.2f} s ahead of the motion and moved back by that"
    return _with_plan(run, signals, signals.time + late, planned, note)


def _with_plan(run: Run, source: Signals, when: Float, planned: Plan, note: str = "", cut: bool = True) -> Run:
    """The run, cut to what a plan at times ``when`` (M,) covers, with that plan on its own time grid.

    Raises ``RecordingError`` where the plan covers too little of the recording.
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
    gaps = np.interp(run.time, when, source.gaps) > 0
    if run.gaps is not None:
        gaps |= run.gaps
    time = np.clip(run.time, when[0], when[-1])
    position = CubicHermiteSpline(when, planned.position, planned.velocity)
    velocity = CubicHermiteSpline(when, planned.velocity, planned.acceleration)
    # Straight lines between accelerations would lack a share of their second derivative, as an elastic joint does.
    plan = Plan(np.asarray(position(time)), np.asarray(velocity(time)), np.asarray(velocity.derivative()(time)))
    more = [f"{run.name}: {note}"] if note else []
    return replace(run, plan=plan, gaps=gaps if gaps.any() else None, notes=(*run.notes, *more))


def _cut(run: Run, part: slice) -> Run:
    lost = len(run.time) - (part.stop - part.start)
    if not lost:
        return run
    note = f"{run.name}: {lost * run.step:.2f} s of the recording lie outside its simulation and are left out"
    return replace(
        run,
        time=run.time[part],
        position=run.position[part],
        velocity=None if run.velocity is None else run.velocity[part],
        torque=run.torque[part],
        power=None if run.power is None else run.power[part],
        temperature=None if run.temperature is None else run.temperature[part],
        command=None if run.command is None else run.command[part],
        gaps=None if run.gaps is None else run.gaps[part],
        notes=(*run.notes, note),
    )


def _simulated(signals: Signals) -> Plan:
    """Planned motion of a simulation, on its own time grid."""
    if "position" not in signals.joints:
        return _targets(signals)
    position = signals.needed("position")
    velocity, acceleration = signals.derivatives("position", "velocity", "acceleration")
    return Plan(position, velocity, acceleration)


def _targets(signals: Signals) -> Plan:
    """The commanded motion that a recording holds."""
    position = signals.needed("target_position")
    velocity, acceleration = signals.derivatives("target_position", "target_velocity", "target_acceleration")
    return Plan(position, velocity, acceleration)
