"""UR10e: current of each joint on trajectories that the model has not seen, and with a load; recordings of ``real``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml
from real import ur10e
from real.recording import Recording

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.plugins.models.power.cases import model_of

from cellwatt_plugins.models.power.moves import Moves, read_moves
from cellwatt_plugins.models.power.scores import Score
from cellwatt_plugins.models.power.training import estimate
from cellwatt_plugins.robot import Arm

TRAINED = (
    "ur-20_02_12-50sec_12harm",
    "ur-20_02_12-40sec_12harm",
    "ur-20_02_06-20sec_10harm",
    "ur-20_02_05-20sec_8harm",
)
UNSEEN = (
    "ur-20_02_10-30sec_12harm",
    "ur-20_02_19_15harm50sec",
    "ur-20_02_19_14harm50sec",
    "ur-20_01_17-ptp_10_points",
)
"""The recording with a load follows the path of the third: no model of the bare arm has seen that path."""
PUBLISHED_WORST = 9.88
"""%: the largest error of a motor current that the paper states for its UR5."""


@dataclass(frozen=True)
class Currents:
    """Errors of predicted currents on one recording."""

    recording: str
    trained_on: str
    share: tuple[float, ...]
    """Root mean square of each joint, % of the current's spread."""
    ampere: tuple[float, ...]


def currents(data: Path, work: Path) -> tuple[Currents, ...]:
    """Held-out trajectories, and the loaded one: by models of the bare arm, and by one that has seen half of it."""
    arm = Arm.load(write_robot(data, work))

    def moves(names: Sequence[str], payload: float = 0.0) -> Moves:
        tables = [_write(ur10e.read(data, name).moving(), work, payload) for name in names]
        return read_moves(tables, arm.description.names)

    bare = moves(TRAINED)
    model = model_of(bare, arm)
    out = [_currents(name, "the bare arm", moves([name]), estimate(model, moves([name]), arm)) for name in UNSEEN]
    ignored, given = moves([ur10e.LOAD]), moves([ur10e.LOAD], ur10e.PAYLOAD)
    out.append(_currents(ur10e.LOAD, "the bare arm, load not given", given, estimate(model, ignored, arm)))
    out.append(_currents(ur10e.LOAD, "the bare arm, 2.805 kg given", given, estimate(model, given, arm)))
    first, second = _halves(given)
    loaded = model_of(joined(bare, first), arm)
    out.append(_currents(f"{ur10e.LOAD}, second half", "the first half too", second, estimate(loaded, second, arm)))
    return tuple(out)


def joined(one: Moves, other: Moves) -> Moves:
    """Moves of both."""
    parts = {
        name: np.concatenate([getattr(one, name), getattr(other, name)])
        for name in ("time", "q", "qd", "current", "power", "payload")
    }
    return Moves(move=np.concatenate([one.move, other.move + one.count]), **parts)


def write_robot(data: Path, work: Path) -> Path:
    """``robot.yaml`` with the published gains; nothing else is known of the drives."""
    work.mkdir(parents=True, exist_ok=True)
    joints = [
        {"name": name, "torque_constant": float(gain), "gear_ratio": ur10e.GEAR}
        for name, gain in zip(ur10e.JOINTS, ur10e.PUBLISHED_GAINS, strict=True)
    ]
    file = work / "ur10e.yaml"
    urdf = (data / ur10e.FOLDER / "ur10e.urdf").resolve()
    file.write_text(yaml.safe_dump({"robot": "ur10e", "urdf": str(urdf), "joints": joints}))
    return file


def _write(recording: Recording, work: Path, payload: float) -> Path:
    groups = {"q": recording.position, "qd": recording.velocity, "current": recording.current}
    columns = {"t": recording.time, "payload": np.full(len(recording.time), payload)}
    for stem, values in groups.items():
        columns |= {f"{stem}_{i + 1}": values[:, i] for i in range(6)}
    path = work / f"{recording.name}-{payload:g}.parquet"
    pq.write_table(pa.table(columns), path)
    return path


def _halves(moves: Moves) -> tuple[Moves, Moves]:
    first = np.arange(len(moves)) < len(moves) // 2
    return moves.where(first), moves.where(~first)


def _currents(recording: str, trained: str, moves: Moves, predicted: tuple[np.ndarray, np.ndarray]) -> Currents:
    score = Score.of(moves, *predicted)
    share = tuple(round(100 * value, 2) for value in score.current if value is not None)
    return Currents(recording, trained, share, tuple(round(v, 4) for v in score.current_rms if v is not None))
