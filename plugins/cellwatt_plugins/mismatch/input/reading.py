"""From what the user gives (recordings, simulations, the robot's description) to runs on even time grids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from cellwatt.errors import RecordingError
from cellwatt.progress import steps
from cellwatt.scheduler import spread
from cellwatt_plugins.mismatch.input.alignment import LATE, SAME, delay
from cellwatt_plugins.mismatch.input.moved import moved
from cellwatt_plugins.mismatch.input.run import Run, Simulated
from cellwatt_plugins.mismatch.input.signals import Signals, motor_torque, read_signals
from cellwatt_plugins.mismatch.simulators import Simulator, is_simulator, load_simulator
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.meter import power_beside, with_meters
from cellwatt_plugins.robot.motion import Moved, Plan, exact

Float = NDArray[np.float64]

ENDINGS = (".part", ".parquet", ".csv", ".txt", ".mcap", ".recording", ".simulation")
"""Taken off a file's name, from the end, to have the run's."""
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

    Simulations belong to the recordings of the same name (``run_01.recording``, ``run_01.simulation``), else to those
    in the same place of the list; a simulator's own file (MJCF, URDF) is run on each. ``meters`` logged the power of
    the recordings in the same place. Raises ``RecordingError`` where a file cannot be used, ``ConfigError`` where the
    description lacks what it needs.
    """
    sources = list(with_meters(recordings, meters))
    every = spread(_read, sources, "reading recordings", shared=robot)
    rate = min(RATE, SAMPLES / sum(float(signals.time[-1] - signals.time[0]) for signals in every))
    slowed = [each.slower(rate) for each in every]
    simulator = _simulator(simulations, robot)
    tables = _matched(recordings, () if simulator is not None else simulations)
    pairs = list(zip(_names(recordings), slowed, tables, strict=True))
    runs = spread(_prepared, pairs, "preparing runs", shared=robot)
    if simulator is None:
        return runs
    return [_run_through(simulator, run) for run in steps(runs, "simulating run")]


def _prepared(told: tuple[str, Signals, Path | None], robot: RobotDescription) -> Run:
    """The run of a name, what was recorded of it, and the file of its simulation."""
    name, signals, simulation = told
    run = Run(
        name=name,
        time=signals.time,
        position=signals.needed("position"),
        velocity=signals.joints.get("velocity"),
        torque=motor_torque(signals, robot),
        power=signals.power,
        temperature=signals.joints.get("temperature"),
        gaps=signals.gaps if signals.gaps.any() else None,
        torque_from="torque" if "torque" in signals.joints else "current",
        notes=signals.notes,
    )
    if simulation is not None:
        simulated = read_signals(simulation, robot)
        return _with_simulation(replace(run, notes=(*run.notes, *simulated.notes)), simulated)
    return _with_targets(run, signals) if "target_position" in signals.joints else run


def _read(source: tuple[Path, Path | None], robot: RobotDescription) -> Signals:
    """A recording, with the power of its meter's own file where there is one."""
    path, meter = source
    signals = read_signals(path, robot)
    if meter is None:
        return signals
    return replace(signals, power=power_beside(meter, signals.time, signals.needed("position")))


def _simulator(simulations: Sequence[Path], robot: RobotDescription) -> Simulator | None:
    """The simulator that a file of one describes; None where tables are given."""
    files = [path for path in simulations if is_simulator(path)]
    if not files:
        return None
    if len(simulations) > 1:
        raise RecordingError(f"{files[0]}: a simulator runs on every recording: give it without other simulations")
    return load_simulator(files[0], [joint.name for joint in robot.joints])


def _run_through(simulator: Simulator, run: Run) -> Run:
    """The run with what a simulator says of the motion that was commanded, or made where no command was recorded."""
    if run.plan is None:
        motion = moved(run)
        plan = Plan(motion.position, motion.velocity, motion.acceleration)
    else:
        plan = run.plan
    torque = simulator.torque(plan.position, plan.velocity, plan.acceleration)
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
        run = _with_simulation(run, read_signals(simulation, robot), cut=False)
    if "acceleration" not in signals.joints:
        return run, None
    return replace(run, plan=None), exact(position, *signals.derivatives("position", "velocity", "acceleration"))


def run_name(path: Path) -> str:
    """A file's name without its endings: ``run_01`` of ``run_01.recording.parquet``."""
    name = path.name
    while (shorter := next((name.removesuffix(e) for e in ENDINGS if name.endswith(e)), "")) != "":
        name = shorter
    return name


def _names(recordings: Sequence[Path]) -> list[str]:
    """One name a run; files of the same name in several folders carry the folder's."""
    names = [run_name(path) for path in recordings]
    if len(set(names)) < len(names):
        names = [f"{path.resolve().parent.name}/{name}" for path, name in zip(recordings, names, strict=True)]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"two recordings are called {twice}: give each once, under a name of its own")
    return names


def _matched(recordings: Sequence[Path], simulations: Sequence[Path]) -> list[Path | None]:
    """The simulation of each recording."""
    if not simulations:
        return [None] * len(recordings)
    by_name = {run_name(path): path for path in simulations}
    names = [run_name(path) for path in recordings]
    if len(by_name) == len(simulations) and len(set(names)) == len(names) and set(by_name) <= set(names):
        return [by_name.get(name) for name in names]
    if len(simulations) != len(recordings):
        raise RecordingError(
            f"{len(recordings)} recordings but {len(simulations)} simulations: give one for each in the same order, "
            "or under the same names (run_01.recording.parquet, run_01.simulation.parquet)"
        )
    return list(simulations)


def _with_simulation(run: Run, simulation: Signals, cut: bool = True) -> Run:
    """The run with what its simulation says; both begin together where neither clock nor motion tells."""
    planned = _simulated(simulation)
    when, note = simulation.time, ""
    own = np.arange(when[0], when[-1], run.step)
    late, error = delay(run.position, onto(own, when, planned.position))
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


def onto(time: Float, when: Float, values: Float) -> Float:
    """Values (M, n) at ``when`` (M,), linearly interpolated at ``time`` (N,): (N, n)."""
    return np.column_stack([np.interp(time, when, one) for one in values.T])


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
