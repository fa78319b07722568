"""Reads chosen values of a meter: groups registers into requests."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ProtocolError, WrongDeviceError
from cellwatt_drivers.modbus_meter.bus import Bus
from cellwatt_drivers.modbus_meter.meter_map import MeterMap
from cellwatt_drivers.modbus_meter.registers import Block, plan
from cellwatt_drivers.shared.modbus import ILLEGAL_ADDRESS, ILLEGAL_VALUE, RefusedError
from cellwatt_drivers.shared.polling import NoAnswerError


class Reader:
    """Values ``names`` of the meter ``unit``; ``left_out`` are those that the meter does not have.

    Registers that the meter refuses to read together are then requested separately. ``count`` receives the name of each
    event to count, ``refused`` each value that is left out and the refusal.
    """

    def __init__(
        self,
        meter: MeterMap,
        names: Sequence[str],
        unit: int,
        retries: int = 0,
        count: Callable[[str], None] = lambda what: None,
        refused: Callable[[str, RefusedError], None] = lambda name, error: None,
    ) -> None:
        self.names = tuple(names)
        self.left_out: set[str] = set()
        self.blocks = plan(meter.slots(self.names), meter.longest_read, meter.gap, meter.word_order)
        self._meter = meter
        self._unit = unit
        self._retries = retries
        self._count = count
        self._refused = refused

    async def read(self, bus: Bus) -> NDArray[np.float64]:
        """Read the register numbers of all values (names,); NaN for those that the meter does not have.

        Raises ``WrongDeviceError`` if it has none of them, and what ``Bus.read`` raises.
        """
        row = np.full(len(self.names), np.nan)
        left, kept = deque(self.blocks), []
        while left:
            block = left.popleft()
            try:
                numbers = await self._ask(bus, block)
            except RefusedError as error:
                if error.code not in {ILLEGAL_ADDRESS, ILLEGAL_VALUE}:
                    raise
                left.extendleft(reversed(self._apart(block, error)))
                continue
            kept.append(block)
            row[list(block.columns)] = numbers
        if not kept:
            raise WrongDeviceError(
                f"unit {self._unit} at {bus.place} has none of the registers of a {self._meter.model}"
            )
        self.blocks = tuple(kept)
        return row

    def _apart(self, block: Block, error: RefusedError) -> tuple[Block, ...]:
        """Return the blocks that replace a refused one."""
        self._count("refused reads")
        parts = block.split()
        if not parts:
            name = self.names[block.columns[0]]
            self.left_out.add(name)
            self._refused(name, error)
        return parts

    async def _ask(self, bus: Bus, block: Block) -> tuple[float, ...]:
        for attempt in range(self._retries + 1):
            try:
                words = await bus.read(self._meter.function, block.address, block.count, self._unit)
                return block.decode(words)
            except NoAnswerError as error:
                self._count(f"{error.reason}s")
                if attempt == self._retries:
                    raise
                self._count("retries")
            except ProtocolError:
                self._count("malformed")
                raise
        raise AssertionError("a range of at least one attempt came to its end")
