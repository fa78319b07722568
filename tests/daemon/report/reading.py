"""A report page as a browser reads it: headings, tables, figures, and what it asks for elsewhere."""

from __future__ import annotations

import base64
import gzip
import json
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from cellwatt.report import page as pages
from cellwatt.report.theme import custom_properties

STYLE = custom_properties() + Path(pages.__file__).with_name("page.css").read_text(encoding="utf-8")
"""The one style sheet of all pages."""


@dataclass
class Page(HTMLParser):
    """What is on a page."""

    text: str
    title: str = ""
    headings: list[tuple[str, str]] = field(default_factory=list)
    tables: dict[str, list[list[str]]] = field(default_factory=dict)
    labels: list[str] = field(default_factory=list)
    figures: list[dict[str, Any]] = field(default_factory=list)
    style: str = ""
    engine: str = ""
    asked: list[str] = field(default_factory=list)
    """Addresses in attributes."""

    def __post_init__(self) -> None:
        super().__init__()
        self._inside: list[str] = []
        self._rows: list[list[str]] = []
        self._id: str | None = None
        self.feed(self.text)

    @property
    def words(self) -> str:
        """All that is read on the page, and its markup, but for scripts."""
        return re.sub(r"<script.*?</script>", "", self.text, flags=re.DOTALL)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.asked += [f"{tag} {name}={given[name]}" for name in ("src", "href", "action") if name in given]
        if tag in ("h1", "h2", "h3"):
            self.headings.append((tag, ""))
        elif tag == "table":
            self._rows = self.tables[given["aria-label"] or ""] = []
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("th", "td"):
            assert tag == "td" or given["scope"] in ("row", "col")
            self._rows[-1].append("")
        elif tag == "figure":
            assert given["role"] == "img"
            self.labels.append(given["aria-label"] or "")
        if tag not in ("meta", "br", "input", "img"):
            self._inside.append(tag)
            self._id = given.get("id")

    def handle_endtag(self, tag: str) -> None:
        while self._inside and self._inside.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        inside = self._inside
        if inside[-1:] == ["title"]:
            self.title += data
        elif inside[-1:] == ["style"]:
            self.style += data
        elif inside[-1:] == ["script"] and self._id == "plotly":
            self.engine = unpacked(data)
        elif inside[-2:] == ["figure", "script"]:
            self.figures.append(json.loads(unpacked(data), parse_constant=_refuse))
        elif inside and inside[-1] in ("h1", "h2", "h3"):
            self.headings[-1] = (self.headings[-1][0], self.headings[-1][1] + data)
        elif "td" in inside or "th" in inside:
            self._rows[-1][-1] += data


def read(path: Path) -> Page:
    """The page in a file."""
    return Page(path.read_text(encoding="utf-8"))


def check(page: Page, most: int = 4_000_000) -> None:
    """What holds for every report page: whole in itself, small, headings in order, every figure and table told."""
    assert len(page.text.encode()) < most
    assert "://" not in page.text
    assert page.asked == []
    assert [tag for tag, _ in page.headings].count("h1") == 1
    assert all(page.labels)
    assert len(page.labels) == len(page.figures)
    assert all(page.tables)
    assert "Plotly" in page.engine or not page.figures
    assert page.style == STYLE
    assert "prefers-color-scheme: dark" in page.style
    assert "@media print" in page.style


def numbers(cell: str) -> list[float]:
    """All numbers in the text of a cell."""
    return [float(found) for found in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", cell.replace("−", "-"))]


def unpacked(text: str) -> str:
    return gzip.decompress(base64.b64decode(text)).decode()


def _refuse(constant: str) -> None:
    raise AssertionError(f"{constant} is no JSON")
