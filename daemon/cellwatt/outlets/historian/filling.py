"""What InfluxDB has already, on disk, and what is to be filled in, from the record. Blocks: for threads."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pydantic import BaseModel, ValidationError

from cellwatt.errors import why
from cellwatt.files import read_bytes
from cellwatt.outlets.historian.gaps import Gaps, Span
from cellwatt.outlets.historian.line_protocol import result_line, row_line
from cellwatt.outlets.historian.recorded import frames_between, results_between
from cellwatt.outlets.historian.settings import InfluxSettings
from cellwatt.outlets.historian.store import PART, write_synced
from cellwatt.outlets.selection import Picker

FILE: Final = "historian-influx.json"
log = logging.getLogger(__name__)


class _Kept(BaseModel):
    place: str
    until: int | None
    gaps: list[Span]


@dataclass(slots=True)
class Reached:
    """Time ``until`` which, UTC ns, everything is written or in ``gaps``; ``None`` where nothing was written yet."""

    until: int | None = None
    gaps: Gaps = field(default_factory=Gaps)

    def text(self, place: str) -> bytes:
        """The file's content; ``place`` is the database it is about."""
        return json.dumps({"place": place, "until": self.until, "gaps": list(self.gaps)}).encode()


def load(folder: Path, place: str) -> Reached:
    """What was reached before; nothing where there is no file, it is damaged, or of another database."""
    try:
        kept = _Kept.model_validate_json(read_bytes(folder / FILE))
    except FileNotFoundError:
        return Reached()
    except (OSError, ValidationError) as error:
        reason = why(error) if isinstance(error, OSError) else "it is not what a daemon wrote"
        log.warning("influx: %s cannot be read, gaps before this start are not filled in: %s", folder / FILE, reason)
        return Reached()
    return Reached(kept.until, Gaps(kept.gaps)) if kept.place == place else Reached()


def save(folder: Path, content: bytes) -> str | None:
    """Bring the file to disk, whole or not at all; return the reason where that cannot be."""
    path = folder / FILE
    part = path.with_name(f"{FILE}{PART}")
    try:
        write_synced(part, content)
        part.replace(path)
    except OSError as error:
        return f"{path} cannot be written: {why(error)}"
    return None


def lines_of(record: Path, cell: str, settings: InfluxSettings, tags: Mapping[str, str], span: Span) -> list[str]:
    """Lines of all that the record has of a span: rows in order, then results."""
    return [text for text in _lines(record, cell, settings, tags, span) if text]


def _lines(record: Path, cell: str, settings: InfluxSettings, tags: Mapping[str, str], span: Span) -> Iterator[str]:
    picker: Picker | None = None
    for block in frames_between(record, cell, *span):
        if picker is None or (picker.layout is not block.layout and picker.layout != block.layout):
            yield from (row_line(settings.measurement, tags, row) for row in (picker.rest() if picker else ()))
            picker = Picker(settings, block.layout)
        rows = list(picker.rows(block))
        yield from (row_line(settings.measurement, tags, row) for row in rows)
    if picker is not None:
        yield from (row_line(settings.measurement, tags, row) for row in picker.rest())
    for result in results_between(record, cell, *span) if settings.results else ():
        yield result_line(settings.measurement, tags, result)
