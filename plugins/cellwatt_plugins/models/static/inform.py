"""A plan as a job for a Yaskawa controller: INFORM, as JBI files (job data format of the NX100, DX and YRC manuals)."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError

Float = NDArray[np.float64]

LONGEST: Final = 900
"""Poses in one job: controllers take 999 steps."""
_LARGEST: Final = 2**31 - 1


@dataclass(frozen=True)
class Encoders:
    """Conversion of joint angles to pulses; as in the settings of the yaskawa driver."""

    pulses_per_degree: Float
    """(n,)."""
    coupling: Float | None = None
    """(n, n): joint angles = coupling · motor angles + zero."""
    zero: Float | None = None
    """(n,) rad at pulse 0."""

    def pulses(self, q: Float) -> NDArray[np.int64]:
        """For angles (N, n) rad. Raises ``ConfigError`` where the settings are of another number of joints."""
        n = q.shape[1]
        if len(self.pulses_per_degree) != n:
            raise ConfigError(f"pulses_per_degree has {len(self.pulses_per_degree)} values, the robot {n} joints")
        motors = q - (0.0 if self.zero is None else self.zero)
        if self.coupling is not None:
            motors = motors @ np.linalg.inv(self.coupling).T
        pulses = np.rint(np.degrees(motors) * self.pulses_per_degree)
        if np.abs(pulses).max() > _LARGEST:
            raise ConfigError("pulses_per_degree: a pose has more pulses than a controller counts")
        return pulses.astype(np.int64)


def jobs(name: str, q: Float, encoders: Encoders, speed: float, hold: float, when: datetime) -> dict[str, str]:
    """File name → text of the jobs that visit ``q`` (N, n) rad and wait ``hold`` s in each.

    ``speed`` is the per cent of the joints' full speed.
    """
    pulses = encoders.pulses(q)
    parts = np.array_split(pulses, -(-len(pulses) // LONGEST))
    names = [name] if len(parts) == 1 else [f"{name}-{i + 1}" for i in range(len(parts))]
    return {f"{n}.JBI": _job(n, part, speed, hold, when) for n, part in zip(names, parts, strict=True)}


def _job(name: str, pulses: NDArray[np.int64], speed: float, hold: float, when: datetime) -> str:
    head = [
        "/JOB",
        f"//NAME {name}",
        "//POS",
        f"///NPOS {len(pulses)},0,0,0,0,0",
        "///TOOL 0",
        "///POSTYPE PULSE",
        "///PULSE",
    ]
    places = [f"C{i:05d}={','.join(map(str, row))}" for i, row in enumerate(pulses.tolist())]
    middle = ["//INST", f"///DATE {when:%Y/%m/%d %H:%M}", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    moves = [line for i in range(len(pulses)) for line in (f"MOVJ C{i:05d} VJ={speed:.2f} PL=0", f"TIMER T={hold:.2f}")]
    return "\r\n".join([*head, *places, *middle, *moves, "END", ""])
