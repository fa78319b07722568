"""Header of a recording, and the names of its files."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from cellwatt.channel import Stream
from cellwatt.errors import RecordingError
from cellwatt.version import __version__
from cellwatt.yaml_file import NotYamlError, parse_yaml

Section = TypeVar("Section", bound=BaseModel)

PART = ".part"
"""Suffix of a file that is not closed yet."""
DAMAGED = ".damaged"
"""Suffix of a file of unreadable bytes."""

_NAME = re.compile(
    r"(?P<cell>.+)_(?P<second>\d{8}T\d{6})_(?P<ns>\d{9})Z_(?P<number>\d{6,})\.mcap(\.part)?(\.\d+)?(\.damaged)?"
)


@dataclass(frozen=True, slots=True)
class Header:
    """Origin of a recording.

    ``session`` is the UTC ns at which the daemon started, ``settings`` the text of its settings file with
    secrets blanked, ``streams`` the declared streams by source. ``number`` counts the files of a session from 1.
    """

    site: str
    cell: str
    session: Annotated[int, Field(ge=0, lt=1 << 63)]
    robot: str | None = None
    settings: str = ""
    streams: Mapping[str, tuple[Stream, ...]] = field(default_factory=dict)
    version: str = __version__
    number: Annotated[int, Field(ge=0, lt=1 << 63)] = 0

    def to_json(self) -> str:
        """The header as JSON text."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str | bytes) -> Header:
        """Decode a header from JSON; raises ``ValueError`` in one line if it is none."""
        try:
            return _HEADER.validate_json(text)
        except ValueError as error:
            reason = " ".join(str(error).split())[:200]
            raise ValueError(f"this version cannot read the header: {reason}") from error


_HEADER: TypeAdapter[Header] = TypeAdapter(Header)


@dataclass(frozen=True, slots=True, order=True)
class FileName:
    """``<cell>_<session in UTC>_<number>.mcap``; sorts by session, then number."""

    session: int
    number: int
    cell: str

    def __str__(self) -> str:
        seconds, ns = divmod(self.session, 1_000_000_000)
        start = datetime.fromtimestamp(seconds, UTC).strftime("%Y%m%dT%H%M%S")
        return f"{plain_cell(self.cell)}_{start}_{ns:09d}Z_{self.number:06d}.mcap"

    @classmethod
    def parse(cls, name: str) -> FileName | None:
        """Parse a file's name (also with the suffix ``.part`` or ``.damaged``); ``None`` if it is another name."""
        match = _NAME.fullmatch(name)
        if match is None:
            return None
        try:
            start = datetime.fromisoformat(f"{match['second']}Z")  # strptime takes ten times as long
        except ValueError:
            return None
        return cls(int(start.timestamp()) * 1_000_000_000 + int(match["ns"]), int(match["number"]), match["cell"])


def closed_name(path: Path) -> Path:
    """Path of a file once it is closed or repaired: it loses the suffix ``.part``, and never gets it back."""
    return path.with_name(path.name.removesuffix(PART))


def plain_cell(cell: str) -> str:
    """A cell's name as used in file names."""
    return re.sub(r"[^\w.-]+", "-", cell)


def recorded_section(settings: str, name: str, model: type[Section]) -> Section:
    """A section of a recording's ``settings``, the text in its header. Raises ``RecordingError``."""
    try:
        written = parse_yaml(settings)
        return model.model_validate((written.get(name) if isinstance(written, dict) else None) or {})
    except NotYamlError as error:
        raise RecordingError(f"the settings in the recording cannot be read: {str(error).splitlines()[0]}") from error
    except ValidationError:
        raise RecordingError(f"{name} in the recording's settings are wrong, or came from the environment") from None
