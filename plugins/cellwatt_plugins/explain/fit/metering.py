"""Whether the recorded power comes from a slow meter, and the meter's values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.rows import Metered, Rows
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.meter.find import find
from cellwatt_plugins.robot.meter.held import held
from cellwatt_plugins.robot.meter.kinds import Course, kinds_of_power
from cellwatt_plugins.robot.meter.model import Meter


@dataclass(frozen=True)
class Metering:
    """A slow meter, and its values in each run that has power."""

    meter: Meter
    rows: tuple[Rows, ...]
    values: tuple[Float, ...]
    """(M,) W of each run."""


@dataclass(frozen=True)
class Unknown:
    """A slow meter whose window and delay the motion does not determine."""

    interval: float
    """s from one value to the next."""


def metering(runs: Sequence[Run], states: Sequence[States]) -> Metering | Unknown | None:
    """The meter that measured the runs' power; None if it is as fast as the recordings.

    States carry the torque that moves the arm.
    """
    powered = [(run, s) for run, s in zip(runs, states, strict=True) if run.power is not None]
    readings = held([(run.time, run.power) for run, _ in powered if run.power is not None])
    if readings is None:
        return None
    meter = find(readings, [Course(s.time, kinds_of_power(s.torque, s.qd)) for _, s in powered])
    if meter is None:
        return Unknown(readings[0].interval)
    rows, values = [], []
    for each, (_, s) in zip(readings, powered, strict=True):
        windows, shown = meter.within(each, s.time)
        rows.append(Metered(s.time, windows, each.interval))
        values.append(shown)
    return Metering(meter, tuple(rows), tuple(values))
