"""Tells torques that cannot be: public sources do not agree on how a controller writes them."""

from __future__ import annotations

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
            axis = strange[0]
            text = f"reads {counts[axis]} counts, {counts[axis] * self._count:.3g} times the rated one"
            hint = "see torque_count; does this controller send floats?"
            self._inlet.event("implausible_torque", f"{self._source}: torque of joint {axis + 1} {text}: {hint}")
