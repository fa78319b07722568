"""LeRobot data sets (v2.1: one episode per file, v3: several per file): state and action of one episode."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError, why
from cellwatt.files import COMPUTED, check_file, read_bytes
from cellwatt.logs.choice import how
from cellwatt.logs.log import Log, Quantity, natural

log = logging.getLogger(__name__)

STATE: Final = "observation.state"
ACTION: Final = "action"
ENDINGS: Final[dict[str, Quantity]] = {
    ".pos": "position",
    ".vel": "velocity",
    ".torque": "torque",
    ".effort": "torque",
}
GRIPPER: Final = "gripper"
"""Word in the name of a gripper, which is stored as a share of its opening and is not a joint of the arm."""
TURN: Final = 2 * np.pi + 0.05
"""Largest angle, rad, of positions that are assumed to be in rad."""
FULL: Final = 100.0
"""Limit, in %, of positions that LeRobot stores as shares of the joint's range."""
UNITS: Final = ("deg", "rad")


def root_of(path: Path) -> Path | None:
    """The folder of the data set that a path is or belongs to; None if there is none."""
    roots = (path,) if path.is_dir() else tuple(path.parents)[:3] if path.suffix == ".parquet" else ()
    return next((root for root in roots if (root / "meta" / "info.json").is_file()), None)


@dataclass(frozen=True)
class DataSet:
    """Content of info.json."""

    fps: float
    names: dict[str, tuple[str, ...]]
    """Names of the values of state and action."""

    @classmethod
    def load(cls, root: Path) -> DataSet:
        """Read info.json. Raises ``RecordingError`` if it is not LeRobot's, or has no joints."""
        path = root / "meta" / "info.json"
        try:
            info = json.loads(read_bytes(path, COMPUTED))
            features = {name: info["features"][name] for name in (STATE, ACTION) if name in info["features"]}
            names = {name: _names(each) for name, each in features.items()}
            fps = float(info["fps"])
            if not fps > 0:
                raise ValueError(f"fps is {fps:g}")
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read: {why(error)}") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise RecordingError(f"{path}: no info.json of a LeRobot data set: {error!r}") from error
        if STATE not in names:
            there = ", ".join(sorted(map(str, info["features"])))
            raise RecordingError(f"{root}: a LeRobot data set without {STATE}; it has {there}")
        return cls(fps, names)


def read(root: Path, path: Path, choice: Sequence[str] = ()) -> Log:
    """Read one episode of a data set or of one of its files; ``choice`` is its number, and ``deg`` or ``rad``.

    Raises ``RecordingError``.
    """
    data = DataSet.load(root)
    units = [each for each in choice if each in UNITS]
    numbers = [each for each in choice if each not in UNITS]
    if len(units) > 1 or len(numbers) > 1 or not all(each.isdecimal() for each in numbers):
        raise RecordingError(f"{root}: expected the number of an episode, deg or rad behind #, not {','.join(choice)}")
    files = [path] if path.is_file() else sorted((root / "data").rglob("*.parquet"))
    state, action, time = _episode(root, files, int(numbers[0]) if numbers else None)
    if not len(time):
        time = np.arange(len(state)) / data.fps
    if not np.all(np.diff(time) > 0):
        raise RecordingError(f"{root}: the timestamps of the episode do not rise from row to row")
    return _log(root, data, state, action, time - time[0], units[0] if units else "")


def _episode(root: Path, files: Sequence[Path], wanted: int | None) -> tuple[Float, Float | None, Float]:
    """State (N, n), action (N, m) and time (N,) s of an episode."""
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    try:
        files_by_episode: dict[int, Path] = {}
        for file in files:
            check_file(file, COMPUTED)
            indexes = pq.read_table(file, columns=["episode_index"]).column(0)
            files_by_episode |= dict.fromkeys(pc.unique(indexes).to_pylist(), file)
        if wanted is None and len(files_by_episode) > 1:
            names = [str(each) for each in sorted(files_by_episode)]
            raise RecordingError(f"{root}: {len(files_by_episode)} episodes: {how(root, names)}")
        episode = next(iter(files_by_episode), None) if wanted is None else wanted
        if episode not in files_by_episode:
            there = f"{min(files_by_episode)} … {max(files_by_episode)}" if files_by_episode else "none"
            raise RecordingError(f"{root}: no episode {'in it' if episode is None else episode}; there are: {there}")
        there = pq.read_schema(files_by_episode[episode]).names
        columns = [name for name in (STATE, ACTION, "timestamp") if name in there]
        table = pq.read_table(files_by_episode[episode], columns=columns, filters=[("episode_index", "=", episode)])
        found = {name: _matrix(table.column(name)) for name in table.column_names}
    except OSError as error:
        raise RecordingError(f"{root}: cannot be read: {why(error)}") from error
    except (pa.ArrowException, ValueError, KeyError) as error:
        raise RecordingError(f"{root}: cannot be read as a LeRobot data set: {' '.join(str(error).split())}") from error
    if STATE not in found or not len(found[STATE]):
        raise RecordingError(f"{root}: episode {episode} has no {STATE}; its columns are {', '.join(there)}")
    return found[STATE], found.get(ACTION), found.get("timestamp", np.empty((0, 1)))[:, 0]


def _matrix(column: Any) -> Float:
    rows = column.to_numpy(zero_copy_only=False)
    return np.stack([np.atleast_1d(np.asarray(row, np.float64)) for row in rows]) if len(rows) else np.empty((0, 1))


def _log(root: Path, data: DataSet, state: Float, action: Float | None, time: Float, unit: str) -> Log:
    found: dict[Quantity, dict[str, Float]] = {}
    for name, values in ((STATE, state), (ACTION, action)):
        if values is None:
            continue
        names = data.names.get(name) or tuple(f"joint_{i + 1}" for i in range(values.shape[1]))
        if len(names) != values.shape[1]:
            raise RecordingError(f"{root}: info.json names {len(names)} values of {name}, which has {values.shape[1]}")
        for written, column in zip(names, values.T, strict=True):
            joint, quantity = _taken_apart(written)
            if name == ACTION:
                if quantity != "position":
                    continue
                quantity = "command"
            found.setdefault(quantity, {})[joint] = column
    left = [joint for joint in found.get("position", {}) if GRIPPER in joint]
    joints = sorted((joint for joint in found.get("position", {}) if GRIPPER not in joint), key=natural)
    if not joints:
        raise RecordingError(f"{root}: no positions of joints in {STATE}, which holds {', '.join(data.names[STATE])}")
    if left:
        log.warning("%s: %s is left out: its value is a share of its opening, not an angle", root, ", ".join(left))
    factor = _factor(root, [found["position"][joint] for joint in joints], unit)
    missing = np.full(len(time), np.nan)
    quantities = {
        quantity: (1.0 if quantity == "torque" else factor)
        * np.column_stack([columns.get(joint, missing) for joint in joints])
        for quantity, columns in found.items()
    }
    return Log(root, tuple(joints), time, quantities)


def _factor(root: Path, positions: Sequence[Float], unit: str) -> float:
    """Factor of the positions to rad. Raises ``RecordingError`` if they are not angles."""
    largest = float(np.nanmax(np.abs(np.stack(positions))))
    if unit == "rad" or (not unit and largest <= TURN):
        return 1.0
    if not unit and np.isclose(largest, FULL, atol=1e-3):
        raise RecordingError(
            f"{root}: positions end at ±100: they are shares of each joint's range in %, no angles: record with "
            f"use_degrees, or give '{root}#deg' if they are degrees"
        )
    if not unit:
        log.warning("%s: positions up to %.0f are read as degrees; use '%s#rad' if they are rad", root, largest, root)
    return float(np.pi / 180)


def _names(feature: dict[str, Any]) -> tuple[str, ...]:
    """Names of a feature's values, from a list or from lists by kind of motor; () without names."""
    names = feature.get("names")
    if isinstance(names, dict):
        names = [each for group in names.values() for each in (group if isinstance(group, list) else [group])]
    return tuple(map(str, names or ()))


def _taken_apart(written: str) -> tuple[str, Quantity]:
    """Joint and quantity of ``shoulder_pan.pos``, or ``main_shoulder_pan`` of older data sets."""
    for ending, quantity in ENDINGS.items():
        if written.endswith(ending):
            return written.removesuffix(ending).removeprefix("main_"), quantity
    return written.removeprefix("main_"), "position"
