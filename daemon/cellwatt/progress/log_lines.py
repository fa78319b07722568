"""Log lines of a process, without the secrets in addresses and with a limit on similar lines."""

from __future__ import annotations

import logging
import sys
import time
from collections import OrderedDict
from typing import Final

from cellwatt.host import blank

SPAN: Final = 60.0
"""Time, s, over which lines of one kind are counted."""
MOST: Final = 20
"""Largest number of lines of one kind within ``SPAN``; further ones are counted, and the count is logged later."""
KINDS: Final = 500
"""Largest number of kinds that are counted; the oldest is discarded."""


class LogLines(logging.StreamHandler):  # type: ignore[type-arg]
    """Writes to stderr. A kind is the logger, the level and the unformatted message.

    A traceback is written once per kind and ``SPAN``. Debug messages are not limited, as a user enabled them.
    """

    def __init__(self) -> None:
        super().__init__(sys.stderr)
        self.setFormatter(logging.Formatter("%(levelname)s %(name)s: %(message)s"))
        self._kinds: OrderedDict[tuple[str, int, str], tuple[float, int]] = OrderedDict()

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, unless the limit of its kind is reached."""
        if record.levelno <= logging.DEBUG:
            super().emit(record)
            return
        kind, now = (record.name, record.levelno, str(record.msg)[:200]), time.monotonic()
        began, count = self._kinds.get(kind, (now, 0))
        if now - began > SPAN:
            if count > MOST:
                self._tell(record, f"{count - MOST} more lines like the next were left out")
            began, count = now, 0
        self._kinds[kind] = began, count + 1
        while len(self._kinds) > KINDS:
            self._kinds.popitem(last=False)
        if count < MOST:
            if count and record.exc_info:
                record = logging.makeLogRecord({**record.__dict__, "exc_info": None, "exc_text": None})
            super().emit(record)
        elif count == MOST:
            self._tell(record, "further lines like the last are left out for a minute")

    def _tell(self, record: logging.LogRecord, text: str) -> None:
        super().emit(logging.LogRecord(record.name, record.levelno, "", 0, text, (), None))

    def format(self, record: logging.LogRecord) -> str:
        """See ``logging.Handler.format``."""
        return blank(super().format(record))


def log_to_stderr(level: int) -> None:
    """Write the log messages of this process, from ``level`` on, to stderr."""
    logging.basicConfig(level=level, handlers=[LogLines()])
