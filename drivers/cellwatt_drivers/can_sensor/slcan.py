"""python-can's bus on a serial adapter, with a count of invalid lines."""

from __future__ import annotations

import re
from contextlib import suppress

from can import CanOperationError, Message
from can.interfaces.slcan import slcanBus

_LINE = re.compile(r"(?:[tTxrRdDbBVNF][0-9A-Fa-f]*|[zZ])?[\r\a]")
"""A frame, a version, a status, or the bare answer to a command."""


class CountingSlcanBus(slcanBus):
    """Leaves out lines that were damaged on the serial port, and counts them in ``malformed``."""

    malformed = 0

    def close(self) -> None:
        """Close the adapter's channel, unless it is gone: ``shutdown`` must get to the serial port."""
        with suppress(CanOperationError):
            super().close()

    def _read(self, timeout: float | None) -> str | None:
        try:
            line = super()._read(timeout)
        except CanOperationError as error:
            if not isinstance(error.__cause__, UnicodeDecodeError):
                raise
            self._buffer.clear()
            line = "?"
        if line is None or _LINE.fullmatch(line):
            return line
        self.malformed += 1
        return None

    def _recv_internal(self, timeout: float | None) -> tuple[Message | None, bool]:
        try:
            return super()._recv_internal(timeout)
        except (ValueError, IndexError):  # a truncated line of valid characters
            self.malformed += 1
            return None, False
