"""Measured power for the rows of a fit: the value of a row, or the mean over a slow meter's window."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csr_array

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.meter.find import find
from cellwatt_plugins.robot.meter.held import held
from cellwatt_plugins.robot.meter.kinds import Course, kinds_of_power
from cellwatt_plugins.robot.meter.model import Readings
from cellwatt_plugins.robot.motion import differentiate

PER_WINDOW: Final = 3
"""Fewest rows in a window, if the recording has them."""


@dataclass(frozen=True)
class Shown:
    """M values of power, and the rows that they were measured in."""

    power: Float
    """(M,) W."""
    rows: NDArray[np.intp]
    """(R,) rows of the fit with a share in the values."""
    at: NDArray[np.intp]
    """(M,) a row of the move that each value is from."""
    matrix: csr_array | None
    """(M, R): weight of each row in each value; None if each value belongs to one row."""

    @classmethod
    def of(cls, moves: Moves, kept: NDArray[np.intp]) -> Shown:
        """The power of rows that are ``kept`` for a fit, evenly spread in each move."""
        if moves.meter is None:
            known = np.flatnonzero(np.isfinite(moves.power[kept]))
            return cls(moves.power[kept][known], known, known, None)
        blocks = []
        values, at = [np.empty(0)], [np.empty(0, np.intp)]
        for first, end in moves.bounds():
            own = np.flatnonzero((kept >= first) & (kept < end))
            readings = readings_of(moves, first, end)
            if len(own) < 2 or not len(readings.time):
                blocks.append(csr_array((0, len(own))))
                continue
            time = moves.time[kept[own]]
            windows, shown = moves.meter.within(readings, time)
            blocks.append(windows.weights(time))
            values.append(shown)
            at.append(np.full(len(shown), own[0]))
        matrix = csr_array(block_diag(blocks))
        return cls(np.concatenate(values), np.arange(len(kept)), np.concatenate(at), matrix)

    def seen(self, rows: Float) -> Float:
        """Rows (N, k) of the fit averaged as the meter does: (M, k)."""
        return rows[self.rows] if self.matrix is None else np.asarray(self.matrix @ rows)


def readings_of(moves: Moves, first: int, end: int) -> Readings:
    """The values of a slow meter in rows ``first`` to ``end`` of one move."""
    assert moves.came is not None
    rows = first + np.flatnonzero(np.isfinite(moves.came[first:end]))
    came = moves.came[rows]
    return Readings(came, moves.power[rows], float(np.median(np.diff(came))) if len(came) > 1 else np.inf)


def spacing(moves: Moves, most: int, rows: int) -> int:
    """Step between rows of a fit, for about ``most`` of ``rows``; a slow meter's windows retain some rows each."""
    every = -(-rows // most)
    if moves.meter is None:
        return every
    return max(1, min(every, int(moves.meter.window / PER_WINDOW / moves.step)))


def through_its_meter(moves: Moves, arm: Arm) -> Moves:
    """The same moves with their meter, if the power is from a slow meter.

    Raises ``RecordingError`` if window and delay of its values cannot be found from the motion.
    """
    bounds = moves.bounds()
    readings = held([(moves.time[a:b], moves.power[a:b]) for a, b in bounds])
    if readings is None or moves.meter is not None:
        return moves
    torque = moves.current * arm.column("torque_constant")
    if not np.isfinite(torque).all():
        torque = arm.body.inverse_dynamics(moves.q, moves.qd, differentiate(moves.qd, moves.step)[0])
    kinds = kinds_of_power(torque, moves.qd)
    meter = find(readings, [Course(moves.time[a:b], kinds[a:b]) for a, b in bounds])
    if meter is None:
        raise RecordingError(
            f"power comes every {readings[0].interval:.2g} s, and the motion does not show when each value was "
            "measured: record more moves, or use a faster meter"
        )
    came = np.full(len(moves), np.nan)
    for (a, b), each in zip(bounds, readings, strict=True):
        rows = np.clip(a + np.searchsorted(moves.time[a:b], each.time), a, b - 1)
        came[rows] = each.time
    return replace(moves, came=came, meter=meter)
