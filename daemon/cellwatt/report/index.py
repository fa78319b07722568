"""The index of a folder's pages: the newest first, by kind, each with its finding and a small picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape
from os.path import relpath
from pathlib import Path
from typing import Final
from urllib.parse import quote

from cellwatt.report.blocks import Html, Notes
from cellwatt.report.facts import BrokenPageError, Facts, facts_in
from cellwatt.report.numbers import capital
from cellwatt.report.page import Report, Section
from cellwatt.report.provenance import Provenance
from cellwatt.report.thumbnail import thumbnail

INDEX: Final = "index of reports"
"""Kind of the page itself, which it does not list."""


@dataclass(frozen=True)
class Listed:
    """One page of the folder."""

    path: Path
    facts: Facts
    picture: Html


@dataclass(frozen=True)
class Index:
    """Pages of a folder and those below it, the newest first, and what is wrong with those that cannot be read."""

    folder: Path
    pages: Sequence[Listed]
    broken: Sequence[str]

    @classmethod
    def of(cls, folder: Path) -> Index:
        """Read every ``*.html`` of a folder; those that are no page of cellwatt are passed over."""
        pages, broken = [], []
        for path in sorted(folder.rglob("*.html")):
            try:
                found = facts_in(path)
                if found is not None and found[0].kind != INDEX:
                    pages.append(Listed(path, found[0], thumbnail(found[1])))
            except BrokenPageError as error:
                broken.append(str(error))
            except ValueError as error:
                broken.append(f"{path}: {error}")
        return cls(folder, sorted(pages, key=lambda page: page.facts.made, reverse=True), broken)

    @property
    def kinds(self) -> dict[str, list[Listed]]:
        """Pages by kind; the kind with the newest page first."""
        out: dict[str, list[Listed]] = {}
        for page in self.pages:
            out.setdefault(page.facts.kind, []).append(page)
        return out

    def report(self, out: Path) -> Report:
        """The page, with addresses as seen from where ``out`` is to be written."""
        count = len(self.pages)
        told = "No reports are here." if not count else f"{count} report{'s' * (count > 1)}, the newest first."
        return Report(
            name=self.folder.resolve().name,
            subject=INDEX,
            facts=[f"{capital(kind)}: {len(pages)}" for kind, pages in self.kinds.items()],
            verdict=told,
            sections=[
                Section("Pages that cannot be read", [Notes(self.broken)]),
                *(
                    Section(capital(kind), [Html(f"<ol class=reports>{''.join(_entries(pages, out))}</ol>")])
                    for kind, pages in self.kinds.items()
                ),
            ],
            tone="part" if self.broken else "good" if count else "open",
            provenance=Provenance.here(),
        )


def _entries(pages: Sequence[Listed], out: Path) -> Iterator[str]:
    for page in pages:
        facts = page.facts
        address = quote(Path(relpath(page.path, out.parent)).as_posix())
        when = f"{datetime.fromisoformat(facts.made):%Y-%m-%d %H:%M}"
        about = escape(" · ".join([when, facts.name, *facts.about]))
        yield (
            f'<li class="{facts.tone}"><a href="{address}">{page.picture}<b>{escape(facts.finding)}</b></a>'
            f"<small>{about}</small></li>"
        )
