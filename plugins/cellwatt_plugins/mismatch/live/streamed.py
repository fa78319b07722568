"""A simulation that runs beside the cell and streams what it says: a source like any other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError
from cellwatt.frames import Frames, Layout
from cellwatt_plugins.mismatch.live.intake import SUPPLY, Intake

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Streamed:
    """The columns of the source that streams the simulation of an arm."""

    columns: tuple[int, ...]
    """As ``Intake.judged``: torque of each joint in Nm, then the supply's power in W where that is compared."""

    def rows(self, frames: Frames) -> Float:
        """Values of the simulation (N, C); NaN where it gave none."""
        return frames.values[:, self.columns]


def streamed(stage: str, source: str, layout: Layout, intake: Intake) -> Streamed | None:
    """The simulation that a source of this name streams; None where no source has the name.

    Raises ``ConfigError`` where the source lacks a torque, or power where the supply is compared, and where the
    arm gives no torque.
    """
    if all(channel.source != source for channel in layout.channels):
        return None
    if intake.driven:
        raise ConfigError(f"stage {stage!r}: source {intake.source} gives no torque to compare with that of {source}")
    names = [f"{source}.joint_{j + 1}.torque" for j in range(len(intake.gain))]
    names += [] if intake.power is None else [f"{source}.{SUPPLY}"]
    if missing := [name for name in names if name not in layout.names]:
        raise ConfigError(
            f"stage {stage!r}: source {source} is to stream the simulation and gives no {', '.join(missing)}"
        )
    columns = tuple(layout.names.index(name) for name in names)
    for column, judged in zip(columns, intake.judged, strict=True):
        if layout.channels[column].unit != judged.unit:
            raise ConfigError(
                f"stage {stage!r}: {layout.names[column]} is in {layout.channels[column].unit}, not in {judged.unit}"
            )
    return Streamed(columns)
