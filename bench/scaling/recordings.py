"""Recordings of one arm with effects that its simulation leaves out; see the package `concealed`, which makes them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from concealed.cases import generator, kind_of
from concealed.describe import robot_yaml, urdf
from concealed.motion import STYLES, TICK
from concealed.plant import simulate, tune
from concealed.record import recording_table, simulation_table, true_power
from concealed.sensing import read
from concealed.setting import NotVisibleError, Setting, new_setting

FAMILY = "collaborative6"
JOINT = 1
LEFT_OUT = (("payload", "strong"), ("stribeck_friction", "strong"), ("converter_efficiency", "medium"))
"""Effects of the case, and how strong each is."""
IN_TURN = ("excite", "task", "sweep", "task")
TOGETHER = 10
"""Runs that MuJoCo steps side by side."""


def _drawn(seed: str) -> tuple[Setting, np.random.Generator]:
    """An arm at which all effects show."""
    for attempt in range(100):
        rng = generator(seed, attempt)
        try:
            setting = new_setting(rng, FAMILY, "short", [JOINT])
            for name, setting.level in LEFT_OUT:
                kind_of(name).draw(setting, JOINT)
        except NotVisibleError:
            continue
        return setting, rng
    raise NotVisibleError(f"{seed}: nothing shows in 100 draws")


def make(folder: Path, count: int, seconds: float, seed: str = "scale") -> list[Path]:
    """Return ``count`` recordings of ``seconds`` each, their simulations beside them; made where they are not there."""
    told = folder / "made.json"
    wanted = {"count": count, "seconds": seconds, "seed": seed}
    recordings = [folder / f"run_{i + 1:03d}.recording.parquet" for i in range(count)]
    if told.exists() and json.loads(told.read_text()) == wanted:
        return recordings
    folder.mkdir(parents=True, exist_ok=True)
    setting, rng = _drawn(seed)
    (folder / "robot.urdf").write_text(urdf(setting.believed))
    (folder / "robot.yaml").write_text(robot_yaml(setting.believed, setting.interface.rate, False))
    control = tune(rng, setting.body, TICK)
    for first in range(0, count, TOGETHER):
        part = recordings[first : first + TOGETHER]
        styles = [IN_TURN[(first + k) % len(IN_TURN)] for k in range(len(part))]
        setting.plans = [STYLES[style](rng, setting.base, seconds, [JOINT], TICK) for style in styles]
        _write(setting, rng, control, part)
    told.write_text(json.dumps(wanted))
    return recordings


def _write(setting: Setting, rng: np.random.Generator, control: object, recordings: Sequence[Path]) -> None:
    trace = simulate(setting.body, setting.plans, control)  # type: ignore[arg-type]
    for copy, path in enumerate(recordings):
        power = true_power(setting, trace, copy)
        reading = read(rng, setting.interface, trace, copy, setting.plans[copy].seconds, power)
        pq.write_table(recording_table(reading, False), path)
        pq.write_table(simulation_table(setting, copy, reading.t), simulation_of(path))


def simulation_of(recording: Path) -> Path:
    """The file that holds what the simulation says of a recording's motion."""
    return recording.with_name(recording.name.replace("recording", "simulation"))
