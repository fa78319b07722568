"""Rows that the broker has, by their times, and the spans that it still lacks. Pure but for ``load`` and ``save``."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cellwatt.errors import why
from cellwatt.files import read_bytes

log = logging.getLogger(__name__)

MOST: Final = 1000
"""Spans that are remembered; beyond that the oldest is given up."""

Span = tuple[int, int]
"""Times of rows, ns: after the first, up to and with the second."""


class Ledger(BaseModel):
    """The account of rows. ``reached`` is the time of the last live row that was delivered, UTC ns.

    ``gaps`` are spans in order whose rows were not delivered. ``births`` is the number that Sparkplug's next
    connection has.
    """

    model_config = ConfigDict(extra="ignore")

    reached: int | None = None
    gaps: list[Span] = []
    births: Annotated[int, Field(ge=0, le=255)] = 0

    def delivered(self, time: int, before: int) -> int:
        """Note a live row, and the time of the one before it; return the number of spans that were given up."""
        lost = self.owe(before)
        self.reached = time
        return lost

    def owe(self, until: int) -> int:
        """Note that rows up to ``until`` were made; return the number of spans that were given up."""
        if self.reached is not None and self.reached < until:
            self.gaps.append((self.reached, until))
        self.reached = until if self.reached is None else max(self.reached, until)
        lost = max(0, len(self.gaps) - MOST)
        del self.gaps[:lost]
        return lost

    def filled(self, time: int, until: int) -> None:
        """Note that the gap that ends at ``until`` is filled up to ``time``."""
        kept = ((max(after, time) if end == until else after, end) for after, end in self.gaps)
        self.gaps = [(after, end) for after, end in kept if after < end]


def load(path: Path | None) -> Ledger:
    """The ledger of a file; a new one where there is none, or it is damaged."""
    if path is None:
        return Ledger()
    try:
        return Ledger.model_validate_json(read_bytes(path))
    except FileNotFoundError:
        return Ledger()
    except (OSError, ValidationError) as error:
        reason = why(error) if isinstance(error, OSError) else "it is damaged"
        log.warning("%s cannot be read (%s): nothing from before this start is sent later", path, reason)
        return Ledger()


def save(path: Path, text: str) -> None:
    """Write a ledger, wholly or not at all. Raises ``OSError``."""
    new = path.with_name(f"{path.name}.new")
    new.write_text(text)
    new.replace(path)


def dump(ledger: Ledger) -> str:
    """A ledger as the text of its file."""
    return json.dumps(ledger.model_dump(mode="json"), separators=(",", ":"))
