"""Reads chosen values of a meter: groups registers into requests."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ProtocolError, WrongDeviceError
from cellwatt_drivers.modbus_meter.meter_map import MeterMap
from cellwatt_drivers.modbus_meter.registers import Block, plan
from cellwatt_drivers.shared.modbus import FAILURE, ILLEGAL_ADDRESS, ILLEGAL_VALUE, LATER, Bus, RefusedError
from cellwatt_drivers.shared.polling import NoAnswerError

_LARGEST_POWER = 10
"""Largest power of ten of a number, as in SunSpec; -32768 means that there is none."""
_ABSENT = {ILLEGAL_ADDRESS, ILLEGAL_VALUE, FAILURE}
"""Exceptions for registers that a meter does not have, or not together; a ``FAILURE`` may also be of the meter."""


class Reader:
    """Values ``names`` of the meter ``unit``; ``left_out`` are those that the meter does not have.

    Registers that the meter refuses to read together are then requested separately, until it is read ``anew``.
    ``count`` receives the name of each event to count, ``refused`` each value that is left out and the refusal.
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
        self.asked = 0
        """Time of the first answered request of the last read, ns, by ``time.monotonic_ns``."""
        exponents = {slot.address: slot for slot in meter.exponents(self.names)}
        slots = [*meter.slots(self.names), *exponents.values()]
        self.blocks = self._plan = plan(slots, meter.longest_read, meter.gap, meter.word_order)
        self._labels = [*self.names, *(f"scale register {address}" for address in exponents)]
        self._missing = [(c, float(m)) for c, n in enumerate(self.names) for m in meter.marks(n)]
        # Without a register of its own, the power of ten of a value is the last column: 0.
        self._powers = [-1 if (a := meter.values[n].scale_register) is None else exponents[a].column for n in names]
        self._meter = meter
        self._unit = unit
        self._retries = retries
        self._count = count
        self._refused = refused

    async def read(self, bus: Bus, anew: bool = True) -> NDArray[np.float64]:
        """Read the register numbers of all values (names,) times their powers of ten; NaN where there is none.

        ``anew``: what the meter refuses is left out until the next such read; otherwise, a refusal is raised.
        Raises ``WrongDeviceError`` if it has none of them, and what ``Bus.read`` raises.
        """
        if anew:
            self.blocks = self._plan
            self.left_out.clear()
        row = np.full(len(self._labels) + 1, np.nan)
        row[-1] = 0.0
        pending, blocks, failure = deque(self.blocks), list[Block](), None
        while pending:
            block = pending.popleft()
            try:
                numbers = await self._ask(bus, block)
            except RefusedError as error:
                if not anew or error.code not in _ABSENT:
                    raise
                failure = error if error.code == FAILURE else failure
                pending.extendleft(reversed(self._apart(block, error)))
                continue
            self.asked = self.asked if blocks else bus.asked
            blocks.append(block)
            row[block.columns] = numbers
        if not blocks:
            raise failure or WrongDeviceError(
                f"unit {self._unit} at {bus.place} has none of the registers of a {self._meter.model}"
            )
        self.blocks = tuple(blocks)
        for column, mark in self._missing:
            if row[column] == mark:
                row[column] = np.nan
        powers = row[self._powers]
        powers[abs(powers) > _LARGEST_POWER] = np.nan
        found: NDArray[np.float64] = row[: len(self.names)] * 10.0**powers
        return found

    def _apart(self, block: Block, error: RefusedError) -> tuple[Block, ...]:
        """Return the blocks that replace a refused one."""
        self._count("refused reads")
        parts = block.split()
        if not parts:
            name = self._labels[block.columns[0]]
            self.left_out.add(name)
            self._refused(name, error)
        return parts

    async def _ask(self, bus: Bus, block: Block) -> tuple[float, ...]:
        for attempt in range(self._retries + 1):
            try:
                words = await bus.read(self._meter.function, block.address, block.count, self._unit)
                return block.decode(words)
            except (NoAnswerError, RefusedError) as error:
                if isinstance(error, NoAnswerError):
                    self._count(f"{error.reason}s")
                if attempt == self._retries or (isinstance(error, RefusedError) and error.code not in LATER):
                    raise
                self._count("retries")
            except ProtocolError:
                self._count("malformed")
                raise
        raise AssertionError("a range of at least one attempt came to its end")
