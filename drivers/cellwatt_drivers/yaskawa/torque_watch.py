"""Tells torques that cannot be: public sources do not agree on how a controller writes them."""

from __future__ import annotations

import math
import struct

from cellwatt.driver import Inlet
from cellwatt_drivers.yaskawa import payload

LARGEST_SHARE = 10.0
"""Of the rated torque; no servo gives more for a moment than a few times the rated one."""


class TorqueWatch:
    """Reports once when torques become implausible; ``count`` is the share of the rated torque of one count.

    What reads the protocol takes answers to 0x77 for whole numbers, Yaskawa's own dissector shows them as floats. A
    float read as a whole number is beyond everything: 10.0 is 1,092,616,192.
    """

    def __init__(self, source: str, inlet: Inlet, count: float) -> None:
        self._source = source
        self._inlet = inlet
        self._count = count
        self._told = False

    def see(self, data: bytes) -> None:
        """Take the data of an answer that was understood."""
        counts = payload.decode_axes(data)
        strange = [n for n, value in enumerate(counts) if abs(value) * self._count > LARGEST_SHARE]
        if not strange:
            self._told = False
        elif not self._told:
            self._told = True
            self._inlet.event("implausible_torque", self._text(data, counts, strange[0]))

    def _text(self, data: bytes, counts: tuple[int, ...], axis: int) -> str:
        text = (
            f"{self._source}: torque of joint {axis + 1} reads {counts[axis]} counts, {counts[axis] * self._count:.3g} "
            "times the rated one: see torque_count"
        )
        floats = struct.unpack_from(f"<{len(counts)}f", data)
        if all(math.isfinite(x) and (x == 0 or 1e-6 < abs(x) * self._count <= LARGEST_SHARE) for x in floats):
            text += f"; read as a float it is {floats[axis]:.4g}: this controller seems to send floats"
        return text
