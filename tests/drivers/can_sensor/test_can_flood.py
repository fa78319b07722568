"""What a bus can send to keep the loop: every turn takes a little of it, nothing is lost."""

from __future__ import annotations

import time

from can import BusABC, Message

from cellwatt_drivers.can_sensor.listening import BusPlace, Listening


class Full(BusABC):
    """A bus on which so many frames wait."""

    def __init__(self, frames: int) -> None:
        self.left = frames
        self._is_shutdown = True

    def _recv_internal(self, timeout: float | None) -> tuple[Message | None, bool]:
        self.left -= 1
        return (Message(arbitration_id=0x521, data=bytes(6)), True) if self.left >= 0 else (None, True)

    def send(self, msg: Message, timeout: float | None = None) -> None:
        raise AssertionError("the driver only listens")

    def shutdown(self) -> None:
        pass


async def test_a_turn_of_the_loop_takes_a_little_of_what_a_bus_holds() -> None:
    bus = Full(10_000)
    listening = Listening(BusPlace("socketcan", "full"), bus, time.time_ns)
    while bus.left > 0:
        listening.drain()
    blocks = []
    while block := await listening.frames(0.05):
        blocks.append(len(block))
    assert sum(blocks) == 10_000 and listening.dropped == 0
    assert max(blocks) <= 256
