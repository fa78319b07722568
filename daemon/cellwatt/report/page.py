"""A report put together: one file that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Literal

from cellwatt.errors import CellwattError
from cellwatt.files import write_file
from cellwatt.report.blocks import Block, Html, joined, quiet
from cellwatt.report.facts import Facts
from cellwatt.report.figure import pack
from cellwatt.report.provenance import Provenance
from cellwatt.report.theme import custom_properties
from cellwatt.version import __version__

PAGE = "Page to write: pictures, tables and what they were made from, as one HTML file."
"""Help of ``--report``."""
Tone = Literal["good", "found", "part", "open"]


@dataclass(frozen=True)
class Section:
    """A heading, a line that says how to read what follows, and the blocks; left out where there are none."""

    title: str
    blocks: Sequence[Block]
    lead: str = ""

    def html(self) -> Html:
        """Its markup."""
        lead = quiet(self.lead) if self.lead else ""
        content = joined(self.blocks)
        return Html(f"<section><h2>{escape(self.title)}</h2>{lead}{content}</section>" if content else "")


@dataclass(frozen=True)
class Tile:
    """A figure beside the verdict; ``role`` gives its colour."""

    label: str
    value: str
    remark: str = ""
    role: str = ""


@dataclass(frozen=True)
class Report:
    """One page: the verdict in one sentence, then sections, then what it was made from."""

    name: str
    """Of the robot or the cell."""
    subject: str
    """Subject of the page, for its title; the same for all pages of a kind, by which an index groups them."""
    facts: Sequence[str]
    """Beside the name, on top."""
    verdict: str
    sections: Sequence[Section]
    tone: Tone = "found"
    badge: str = ""
    tiles: Sequence[Tile] = ()
    tiles_remark: str = ""
    beside: Block = ""
    """About files beside the page."""
    provenance: Provenance = field(default_factory=Provenance.here)

    def write(self, path: Path) -> None:
        """Write the page to ``path``. Raises ``CellwattError`` where that fails or plotly is missing."""
        write_file(path, self.html())

    def html(self) -> str:
        """The page. Raises ``CellwattError`` where plotly is not installed."""
        body = "".join(section.html() for section in self.sections)
        engine = _engine() if "<figure" in body else ""
        footer = f"<footer>{joined([self.beside] if self.beside else [])}{self.provenance.html()}</footer>"
        return (
            '<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content="width=device-width">'
            f"<title>{escape(self.name)}: {escape(self.subject)}</title>{self.about.html()}"
            f"<style>{custom_properties()}{_part('page.css')}</style><main>{self._head()}{body}{footer}</main>"
            f"{engine}<script>{_part('page.js')}</script></html>"
        )

    @property
    def about(self) -> Facts:
        """Facts about the page for programs."""
        origin = self.provenance
        return Facts(
            name=self.name,
            kind=self.subject,
            finding=self.verdict,
            tone=self.tone,
            about=tuple(self.facts),
            files=origin.files,
            command=origin.command,
            made=origin.made.isoformat(timespec="seconds"),
            version=__version__,
        )

    def _head(self) -> str:
        facts = escape(" · ".join(self.facts))
        tiles = "".join(
            f"<div class={tile.role or 'plain'}><dt>{escape(tile.label)}</dt><dd>{escape(tile.value)}</dd>"
            f"<small>{escape(tile.remark)}</small></div>"
            for tile in self.tiles
        )
        remark = quiet(self.tiles_remark) if tiles and self.tiles_remark else ""
        return (
            f"<header class=top><b>{escape(self.name)}</b> <span>{facts}</span></header>"
            f'<section class="verdict {self.tone}"><p class=badge>{escape(self.badge)}</p>'
            f"<h1>{escape(self.verdict)}</h1>{f'<dl class=tiles>{tiles}</dl>' if tiles else ''}{remark}</section>"
        )


@cache
def _engine() -> str:
    """Plotly itself, for the browser."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise CellwattError("the report needs plotly: pip install 'cellwatt[plot]'") from error
    return f"<script type=text/plain id=plotly>{pack(get_plotlyjs())}</script>"


def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
