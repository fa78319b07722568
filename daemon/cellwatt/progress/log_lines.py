"""Lines of the log of a process: without secrets of addresses, and never a flood of the same."""

from __future__ import annotations

import logging
import sys
import time
from collections import OrderedDict
from typing import Final

from cellwatt.host import blank

SPAN: Final = 60.0
"""s over which lines of a kind are counted."""
MOST: Final = 20
"""Lines of a kind within ``SPAN``; those beyond are counted, and told with the next one."""
KINDS: Final = 500
"""Kinds that are remembered; the oldest goes."""


class LogLines(logging.StreamHandler):  # type: ignore[type-arg]
    """Writes to stderr. A kind is the logger, the level and the text before its parts are filled in.

    Of a kind, the traceback is written once in ``SPAN``. Debug messages, which somebody asked for, all come.
    """

    def __init__(self) -> None:
        super().__init__(sys.stderr)
        self.setFormatter(logging.Formatter("%(levelname)s %(name)s: %(message)s"))
        self._kinds: OrderedDict[tuple[str, int, str], tuple[float, int]] = OrderedDict()

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, unless there were too many like it."""
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
    """Have what is logged in this process from a level on written to stderr."""
    logging.basicConfig(level=level, handlers=[LogLines()])
