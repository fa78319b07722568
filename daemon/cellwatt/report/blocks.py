"""Blocks of a page: text, tables, bars, cards; every text that is not markup is escaped here."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Protocol

from cellwatt.progress.terminal import aligned
from cellwatt.report.numbers import decimals_for, fixed, unit


class Html(str):
    """Markup that is put on the page unchanged; any other text is escaped."""

    __slots__ = ()


class HtmlBlock(Protocol):
    """A block that generates its own markup."""

    def html(self) -> Html:
        """Its markup."""
        ...


Block = str | HtmlBlock
_TAG = re.compile("<[^>]*>")
_NUMBER = re.compile(r"[(−<>×\s]*\d.{,30}$|–$|not told$")


def markup(content: Block) -> Html:
    """Markup of a block within a line; text is escaped."""
    if isinstance(content, Html):
        return content
    return Html(escape(content)) if isinstance(content, str) else content.html()


def joined(blocks: Sequence[Block]) -> Html:
    """Markup of blocks below each other; a text becomes a paragraph."""
    return Html("".join(f"<p>{escape(b)}</p>" if type(b) is str else markup(b) for b in blocks))


@dataclass(frozen=True)
class Table:
    """A table whose first column contains the names of the rows; columns of numbers are right-aligned.

    ``label`` describes the table for screen readers; without ``heads`` it is a list of names and values.
    """

    label: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    kinds: Sequence[str] = ()
    """CSS class of each row; empty: no classes."""

    def html(self) -> Html:
        """Its markup."""
        columns = zip(*self.rows, strict=True)
        right = [
            i > 0 and all(_NUMBER.match(_TAG.sub("", cell)) for cell in column) for i, column in enumerate(columns)
        ]
        heads = "".join(
            f"<th scope=col{' class=n' * (i < len(right) and right[i])}>{markup(head)}</th>"
            for i, head in enumerate(self.heads)
        )
        kinds = self.kinds or [""] * len(self.rows)
        body = "".join(
            f"<tr{f' class={kind}' if kind else ''}><th scope=row>{markup(row[0])}</th>"
            + "".join(f"<td{' class=n' * right[i]}>{markup(c)}</td>" for i, c in enumerate(row[1:], start=1))
            + "</tr>"
            for row, kind in zip(self.rows, kinds, strict=True)
        )
        head = f"<thead><tr>{heads}</tr></thead>" if self.heads else ""
        label = escape(self.label)
        return Html(f'<div class=wide><table aria-label="{label}">{head}<tbody>{body}</tbody></table></div>')

    def text(self) -> str:
        """The table for a terminal: its label, then one line per row, numbers right-aligned."""
        return "\n".join([self.label, *aligned([self.heads, *self.rows], numbers=True)])


@dataclass(frozen=True)
class Bars:
    """Bars in one unit: label, role (sets the colour) and value of each; ``floor``: noise floor, marked in all bars."""

    rows: Sequence[tuple[str, str, float]]
    unit: str
    floor: float = math.nan

    def html(self) -> Html:
        """Its markup."""
        known = [v for v in (*(v for _, _, v in self.rows), self.floor) if math.isfinite(v)]
        top = max([*known, 0.0]) * 1.04 or 1.0
        marked = math.isfinite(self.floor)
        digits = decimals_for(
            self.floor if marked and self.floor > 0 else min((v for v in known if v > 0), default=top)
        )
        text = escape(unit(self.unit))
        drawn = "".join(
            f"<span>{escape(label)}</span>{bar(value / top if math.isfinite(value) else 0, role)}"
            f"<span class=value>{fixed(value, digits)} {text}</span>"
            for label, role, value in self.rows
        )
        value = f"<span class=value>{fixed(self.floor, digits)} {text}</span>"
        last = f"<span>noise floor</span><div></div>{value}"
        mark = f' style="--at:{100 * self.floor / top:.1f}%"' if marked else ""
        return Html(f"<div class=bars{mark}>{drawn}{last if marked else ''}</div>")


@dataclass(frozen=True)
class Card:
    """A box with a title; ``tag`` and ``aside`` are beside the title, ``tone`` sets the colour of the edge."""

    title: str
    blocks: Sequence[Block]
    tag: str = ""
    aside: str = ""
    tone: str = "found"

    def html(self) -> Html:
        """Its markup."""
        tag = f"<span class=tag>{escape(self.tag)}</span>" if self.tag else ""
        aside = f"<span class=aside>{escape(self.aside)}</span>" if self.aside else ""
        head = f"<header><h3>{escape(self.title)}</h3>{tag}{aside}</header>"
        return Html(f'<article class="card {self.tone}">{head}{joined(self.blocks)}</article>')


@dataclass(frozen=True)
class Columns:
    """Two stacks of blocks side by side."""

    left: Sequence[Block]
    right: Sequence[Block]

    def html(self) -> Html:
        """Its markup."""
        return Html(f"<div class=columns><div>{joined(self.left)}</div><div>{joined(self.right)}</div></div>")


@dataclass(frozen=True)
class Folded:
    """Blocks below a title that expands and collapses them."""

    title: str
    blocks: Sequence[Block]
    open: bool = False

    def html(self) -> Html:
        """Its markup."""
        state = " open" * self.open
        return Html(f"<details{state}><summary>{escape(self.title)}</summary>{joined(self.blocks)}</details>")


@dataclass(frozen=True)
class Switch:
    """A selector of the figures shown, those with ``when`` of this name; empty if there is only one choice."""

    name: str
    choices: Sequence[str]

    def html(self) -> Html:
        """Its markup."""
        buttons = "".join(
            f'<label><input type=radio name={self.name} value="{i}"{" checked" * (i == 0)}>'
            f"<span>{escape(choice)}</span></label>"
            for i, choice in enumerate(self.choices)
        )
        group = f'<div class=switch role=radiogroup aria-label="Shown {escape(self.name)}">{buttons}</div>'
        return Html(group if len(self.choices) > 1 else "")


@dataclass(frozen=True)
class Notes:
    """A list of remarks."""

    items: Sequence[str]

    def html(self) -> Html:
        """Its markup."""
        items = "".join(f"<li>{markup(item)}</li>" for item in self.items)
        return Html(f"<ul class=notes>{items}</ul>" if items else "")


def bar(share: float, role: str = "") -> Html:
    """A bar that fills a ``share`` of its track."""
    return Html(
        f'<div class=track><i class={role or "model"} style="width:{100 * min(max(share, 0), 1):.1f}%"></i></div>'
    )


def inline(*parts: str) -> Html:
    """Texts and markup joined in one line."""
    return Html("".join(map(markup, parts)))


def bold(text: str) -> Html:
    """A text in bold."""
    return Html(f"<b>{escape(text)}</b>")


def quiet(text: str) -> Html:
    """A small remark."""
    return Html(f"<p class=quiet>{markup(text)}</p>")


def heading(text: str) -> Html:
    """A heading within a section."""
    return Html(f"<h3>{escape(text)}</h3>")
