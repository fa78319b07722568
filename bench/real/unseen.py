"""Judge `explain` on motion that it did not see, beside the simulation and a plain regression."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from cellwatt_plugins.robot import Arm
from real import kr300, kuka, panda, shanghai, ur10e
from real.coupled import coupled
from real.describe import Drives, nothing, write_robot
from real.identify import BAND, RATE, even_time, identify, low_pass, resampled
from real.logged import LOGGERS
from real.product import explain, simulate
from real.recording import Float, Recording
from real.regression import Grid, predicted

ENDS = 0.5
"""s at either end of the unseen motion that the low-pass spoils."""


@dataclass(frozen=True)
class Case:
    """What a user has, and the motion that is kept from the tool."""

    robot: Path
    seen: list[Recording]
    unseen: Recording


def judged(case: Case, seconds: float, logger: str = "source") -> dict[str, Any]:
    """Errors (n,) Nm of simulation, model and regression on the unseen motion, the names, and how long it took.

    ``explain`` may compute for ``seconds``, and gets the recordings as the ``logger`` would have written them.
    """
    arm = Arm.load(case.robot)
    folder = case.robot.parent
    time = even_time(case.unseen)
    measured = low_pass(resampled(time, case.unseen.time, case.unseen.effort(arm.column("torque_constant"))), BAND)
    options = ("--no-report", "-q", "--time", str(seconds))
    said = explain([LOGGERS[logger](r).save(folder) for r in case.seen], case.robot, folder / "out", *options)
    motion = folder / "motion.parquet"
    table = pq.read_table(case.unseen.save(folder))
    pq.write_table(table.select([c for c in table.column_names if not c.startswith(("tau", "current"))]), motion)
    told = pq.read_table(simulate(folder / "out" / "model.yaml", motion, folder / "prediction.parquet"))
    model = np.column_stack([told[f"tau_{j + 1}"].to_numpy() for j in range(arm.joints)])
    regression, terms = predicted(case.seen, case.unseen, arm)
    error = {
        "simulation": _error(measured, low_pass(Grid.of(case.unseen, arm).simulated, BAND)),
        "model": _error(measured, low_pass(resampled(time, told["t"].to_numpy(), model), BAND)),
        "regression": _error(measured, regression),
    }
    spread = measured.std(axis=0)
    whole = {name: float(np.sqrt(np.nanmean(np.square(values / spread)))) for name, values in error.items()}
    worse = (error["model"] > 1.05 * error["simulation"]) & (error["model"] - error["simulation"] > 0.005 * spread)
    return {
        "error": {name: values.round(4).tolist() for name, values in error.items()},
        "over_spread": {name: round(value, 4) for name, value in whole.items()},
        "to_regression": round(whole["model"] / whole["regression"], 3),
        "worse_at_joints": (np.flatnonzero(worse) + 1).tolist(),
        "regression_terms": terms,
        **said.summary(),
    }


def _error(measured: Float, told: Float) -> Float:
    inner = slice(int(ENDS * RATE), -int(ENDS * RATE))
    return np.asarray(np.sqrt(np.mean(np.square(measured - told)[inner], axis=0)))


def _ur10e_urdf(data: Path, work: Path) -> Case:
    """The maker's URDF; nothing known of rotors and friction."""
    robot = ur10e.write(data, work, nothing(6, ur10e.controller_gains(data), ur10e.GEAR))
    return Case(robot, [ur10e.moving(data, ur10e.NO_LOAD[0])], ur10e.moving(data, ur10e.UNSEEN_NO_LOAD))


def _ur10e_known(data: Path, work: Path, seen: str, unseen: str | None) -> Case:
    """Links, rotors, Coulomb and viscous friction identified without a load, on other recordings."""
    others = [ur10e.read(data, name) for name in ur10e.NO_LOAD[1:]]
    known = identify(others, ur10e.body(data), ur10e.controller_gains(data), ur10e.GEAR)
    robot = ur10e.write(data, work, known.drives, known.links)
    recording = ur10e.moving(data, seen)
    if unseen is None:
        return Case(robot, *_split(recording))
    return Case(robot, [recording], ur10e.moving(data, unseen))


def _coupled(case: Case, first: int, second: int, ratio: float = 1.0) -> Case:
    """As if the motor of joint ``second`` (0-based) also turned ``ratio`` times with joint ``first``."""
    constants = np.where(case.unseen.torque is None, Arm.load(case.robot).column("torque_constant"), 1.0)
    *seen, unseen = coupled([*case.seen, case.unseen], first, second, ratio, constants)
    return Case(case.robot, seen, unseen)


def _panda(data: Path, work: Path, coulomb: Float) -> Case:
    zero = np.zeros(7)
    robot = write_robot(work, "panda", panda.JOINTS, panda.urdf(), Drives(coulomb, zero, zero, zero), 1000.0)
    return Case(robot, *_split(panda.read(data)))


def _lwr(data: Path, work: Path, model: str) -> Case:
    robot = write_robot(work, model, kuka.JOINTS, kuka.urdf(data, model), nothing(7), 200.0)
    first, _, other = (kuka.read(data, run) for run in kuka.RUNS)
    seen, unseen = _split(other)
    return Case(robot, [first, *seen], unseen)


def _kr300(data: Path, work: Path, told: Drives) -> Case:
    robot = kr300.write(work, told)
    *seen, unseen = (kr300.read(data, run) for run in kr300.RUNS)
    return Case(robot, seen, unseen)


def _shanghai(data: Path, work: Path) -> Case:
    robot = write_robot(work, "shanghai", shanghai.JOINTS, shanghai.urdf(), nothing(6), shanghai.RATE)
    *seen, unseen = (shanghai.read(data, run) for run in shanghai.RUNS)
    return Case(robot, seen, unseen)


def _split(recording: Recording) -> tuple[list[Recording], Recording]:
    """The first two thirds of the only recording, and the last."""
    end = float(recording.time[-1])
    first, last = recording.between(0.0, 2 * end / 3), recording.between(2 * end / 3, end)
    return [replace(first, name="seen")], replace(last, name="unseen", time=last.time - last.time[0])


_FREE = np.zeros(6)
CASES: Mapping[str, tuple[str, Callable[[Path, Path], Case]]] = {
    "ur10e-urdf": (ur10e.FOLDER, _ur10e_urdf),
    "shanghai-prior": (shanghai.FOLDER, _shanghai),
    "kr300-rotors": (
        kr300.FOLDER,
        lambda data, work: _kr300(data, work, replace(kr300.drives(), coulomb=_FREE, viscous=_FREE)),
    ),
    "panda-links": (panda.FOLDER, lambda data, work: _panda(data, work, np.zeros(7))),
    "lwr-identified": (kuka.FOLDER, lambda data, work: _lwr(data, work, "identified")),
    "ur10e-load": (ur10e.FOLDER, lambda data, work: _ur10e_known(data, work, ur10e.LOAD, None)),
    "ur10e-known": (
        ur10e.FOLDER,
        lambda data, work: _ur10e_known(data, work, ur10e.NO_LOAD[0], ur10e.UNSEEN_NO_LOAD),
    ),
    "kr300-friction": (kr300.FOLDER, lambda data, work: _kr300(data, work, kr300.drives())),
    "panda-friction": (panda.FOLDER, lambda data, work: _panda(data, work, panda.FRICTION)),
    "ur10e-coupled": (ur10e.FOLDER, lambda data, work: _coupled(_ur10e_urdf(data, work), 4, 5)),
    "panda-coupled": (panda.FOLDER, lambda data, work: _coupled(_panda(data, work, np.zeros(7)), 5, 6)),
    "lwr-coupled": (kuka.FOLDER, lambda data, work: _coupled(_lwr(data, work, "identified"), 4, 5)),
    "ur10e-geared": (ur10e.FOLDER, lambda data, work: _coupled(_ur10e_urdf(data, work), 3, 4, 0.67)),
    "panda-geared": (panda.FOLDER, lambda data, work: _coupled(_panda(data, work, np.zeros(7)), 5, 6, -0.45)),
    "lwr-a-priori": (kuka.FOLDER, lambda data, work: _lwr(data, work, "a_priori")),
}
"""The folder that a case needs, and what a user has there."""
