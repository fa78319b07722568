"""``cw.explain`` and ``cw.simulate``, called by the commands of the same name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from cellwatt.errors import ConfigError, RecordingError
from cellwatt.files import Place, Places, paths_of
from cellwatt.tables import read_table
from cellwatt_plugins.explain.explain import Explained
from cellwatt_plugins.explain.explain import explain as explain_runs
from cellwatt_plugins.explain.input.admission import admit
from cellwatt_plugins.explain.input.reading import read_motion, read_sources
from cellwatt_plugins.explain.input.selection import select
from cellwatt_plugins.explain.input.sources import simulator_file, sources
from cellwatt_plugins.explain.model import Prediction, load_model, predict_states
from cellwatt_plugins.explain.verdict.other_recordings import compare, with_others
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.description import robot_file
from cellwatt_plugins.robot.simulated import described


def explain(
    recordings: Places,
    *,
    robot: Place | Arm | None = None,
    simulation: Places = (),
    meter: Places = (),
    seconds: float = 50.0,
) -> Explained:
    """Explain where recordings differ from the simulation, which physics it lacks, and how much a model improves it.

    ``recordings`` are Parquet, CSV or cellwatt recordings with t (s), q_i (rad), qd_i (rad/s), tau_i (Nm) and power
    (W). ``simulation`` is the simulator's output in the same form, one file per recording, or the simulator's own file
    (MJCF, URDF). Without ``simulation``, ``robot`` (robot.yaml, or its folder) is simulated on the recorded motion;
    without ``robot``, the simulator's file describes the arm. ``meter`` are tables of power on a clock of their own,
    one per recording. Of many recordings, those whose motions differ most are analysed; the others are compared with
    the resulting model. The search stops after ``seconds`` of computing. The result has ``findings``, the augmented
    ``model``, ``as_json`` and ``report``.

    Raises ``RecordingError`` if a file cannot be used, ``ConfigError`` if the description lacks required values.
    """
    recorded, simulated, metered = paths_of(recordings), paths_of(simulation), paths_of(meter)
    if not recorded:
        raise RecordingError("no recording given")
    simulator = simulator_file(simulated)
    arm = robot if isinstance(robot, Arm) else arm_of(robot, simulator, recorded)
    with threadpool_limits(1):
        close, rest = select(sources(recorded, simulated, metered), arm.description)
        runs = read_sources(close, arm.description, simulator)
        found = explain_runs(runs, admit(runs, arm), seconds)
        rate = 1 / min(run.step for run in runs)
        others = compare(rest, found.findings, found.model, simulator, rate)
        found = replace(found, findings=with_others(found.findings, others, len(close)))
    own = () if robot is None or isinstance(robot, Arm) else (robot_file(robot),)
    files = dict.fromkeys((*recorded, *simulated, *metered, *own, arm.description.urdf))
    return replace(found, inputs=tuple(files), simulator=simulator)


def arm_of(robot: Place | None, simulator: Path | None, recordings: Sequence[Path]) -> Arm:
    """The arm of ``robot``, or of the simulator's file with as many joints as the first recording.

    Raises ``ConfigError`` and ``RecordingError``.
    """
    if robot is not None:
        return Arm.load(robot)
    if simulator is None:
        raise ConfigError("no description of the arm: give --robot robot.yaml, or a simulator's file (MJCF, URDF)")
    table = read_table(recordings[0])
    joints = table.named or len(table.joint_names("position") or table.joint_names("target_position"))
    return Arm.of(described(simulator, joints or None))


def simulate(model: Place, motion: Place, simulation: Place | None = None) -> Prediction:
    """Predict torque (N, n) Nm and supply power (N,) W of a motion with a model written by ``explain``.

    ``model`` is ``model.yaml`` or its folder. ``motion`` is a table with t, q_i, qd_i and qdd_i, and temperature_i
    (degC) where it is known. With qdd_i, the motion is treated as planned; without, as measured, and is smoothed using
    ``simulation``. ``simulation`` is the output of the user's simulator for that motion; the model adds to it. Raises
    ``ConfigError`` and ``RecordingError``.
    """
    loaded = load_model(Path(model))
    with threadpool_limits(1):
        run, known = read_motion(Path(motion), None if simulation is None else Path(simulation), loaded.robot)
        return predict_states(loaded, loaded.baseline.states(run, known))
