"""A complete report: one HTML file that needs no network."""

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
"""Help text of ``--report``."""
Tone = Literal["good", "found", "part", "open"]


@dataclass(frozen=True)
class Section:
    """A heading, a line ``lead`` on how to read the section, and blocks; omitted if the blocks are empty."""

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
    """A value beside the verdict; ``role`` sets its colour."""

    label: str
    value: str
    remark: str = ""
    role: str = ""


@dataclass(frozen=True)
class Report:
    """One page: the verdict in one sentence, then sections, then the provenance."""

    name: str
    """Name of the robot or the cell."""
    subject: str
    """Subject of the page, for its title; the same for all pages of a kind, as an index groups pages by it."""
    facts: Sequence[str]
    """Short texts beside the name, at the top."""
    verdict: str
    sections: Sequence[Section]
    tone: Tone = "found"
    badge: str = ""
    tiles: Sequence[Tile] = ()
    tiles_remark: str = ""
    beside: Block = ""
    """Block about files beside the page."""
    provenance: Provenance = field(default_factory=Provenance.here)

    def write(self, path: Path) -> None:
        """Write the page to ``path``. Raises ``CellwattError`` if that fails or plotly is missing."""
        write_file(path, self.html())

    def html(self) -> str:
        """The page. Raises ``CellwattError`` if plotly is needed but not installed."""
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
        """Machine-readable facts about the page."""
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
