"""Machine-readable facts in the head of a page."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter, ValidationError

from cellwatt.errors import CellwattError, why
from cellwatt.files import read_bytes
from cellwatt.report.blocks import Html

LONGEST: Final = 64_000_000
"""Largest size, bytes, of a page and of a file beside it."""
_OPEN: Final = '<script type="application/json" id="cellwatt">'
_FOUND: Final = re.compile(re.escape(_OPEN) + "(.*?)</script>", re.DOTALL)
_END: Final = "</html>"


@dataclass(frozen=True)
class Facts:
    """Facts about a page."""

    name: str
    """Name of the robot or the cell."""
    kind: str
    """Subject of the page, the same for all pages of a kind."""
    finding: str
    """The verdict, one sentence."""
    tone: str
    """``good``, ``found``, ``part`` or ``open``."""
    about: tuple[str, ...]
    """Short texts about the input data, e.g. the number of recordings and their length."""
    files: Mapping[str, str]
    """Input files: path → SHA-256, hex."""
    command: str
    """Command line; empty if no command made the page."""
    made: str
    """Time of creation, ISO 8601, UTC."""
    version: str
    """Version of cellwatt."""

    def html(self) -> Html:
        """Markup for the head of the page."""
        return Html(f"{_OPEN}{json.dumps(asdict(self), ensure_ascii=False).replace('<', chr(92) + 'u003c')}</script>")


class BrokenPageError(CellwattError):
    """A page of cellwatt that is truncated or unreadable."""


_FACTS: TypeAdapter[Facts] = TypeAdapter(Facts)


def facts_in(path: Path) -> Facts | None:
    """Facts of a page; None if the file is not a page of cellwatt.

    Raises ``BrokenPageError`` if the page is truncated or its facts are invalid, or if the file cannot be read.
    """
    try:
        text = read_bytes(path, LONGEST).decode("utf-8", "replace")
    except OSError as error:
        raise BrokenPageError(f"{path}: cannot be read: {why(error)}") from error
    if _OPEN not in text:
        return None
    found = _FOUND.search(text)
    if found is None or not text.rstrip().endswith(_END):
        raise BrokenPageError(f"{path}: the page ends too early: make it anew")
    try:
        return _FACTS.validate_json(found[1])
    except ValidationError:
        raise BrokenPageError(f"{path}: its facts cannot be read: make the page anew") from None
