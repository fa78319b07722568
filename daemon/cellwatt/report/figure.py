"""A figure of one or more panels for plotly, without plotly's own classes, which validate every number."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any, Literal

from cellwatt.report.blocks import Html
from cellwatt.report.theme import GRID, LAYOUT

Json = dict[str, Any]

GAP, TITLED_GAP, COLUMN_GAP = 16, 62, 0.035
"""Gap between rows without and with an axis title, pixels; gap between columns, share of the width."""
BOTTOM, TOP, LEGEND = 50, 14, 20
"""Margins, pixels."""
OVER_TIME = 190
"""Height, pixels, of a panel of curves over time."""


@dataclass(frozen=True)
class Axis:
    """An axis: its title with the unit, and deviations from plotly's defaults."""

    title: str = ""
    span: tuple[float, float] | None = None
    ticks: Mapping[float, str] | None = None
    """Position → text."""
    grid: bool = True
    labels: bool = True
    names: bool = False
    """True: a category axis of names, the first on top."""

    def layout(self) -> Json:
        """The axis for plotly."""
        out: Json = {**GRID, "ticks": "", "showgrid": self.grid, "zeroline": self.grid, "showticklabels": self.labels}
        out["title"] = {"text": escape(self.title), "standoff": 6}
        if self.names:
            out |= {"type": "category", "autorange": "reversed", "ticklabelstandoff": 4, "automargin": True}
        if self.span is not None:
            out["range"] = list(self.span)
        if self.ticks is not None:
            out |= {"tickvals": list(self.ticks), "ticktext": list(map(escape, self.ticks.values())), "tickangle": 0}
        return out


@dataclass(frozen=True)
class Panel:
    """One diagram: traces and marks from ``cellwatt.report.drawing`` on two axes."""

    traces: Sequence[Json]
    x: Axis = Axis()
    y: Axis = Axis()
    marks: Sequence[Json] = ()
    title: str = ""


@dataclass(frozen=True)
class Figure:
    """Rows of panels, ``heights`` pixels each. ``label`` describes the figure for screen readers.

    A single panel in a row has the whole width. ``shared``: all panels use the last ``x`` or the first ``y`` axis.
    """

    label: str
    rows: Sequence[Sequence[Panel]]
    heights: Sequence[int]
    shared: Literal["", "x", "y"] = ""
    legend: bool = True
    own_legends: bool = False
    """True: one legend beside each panel instead of one for all."""
    sides: tuple[int, int] = (64, 14)
    """Margins left and right, pixels."""
    layout: Json = field(default_factory=dict)
    """Further entries of plotly's layout."""
    when: tuple[str, int] | None = None
    """Name of a ``Switch`` and index of the choice for which this figure is shown; the initial choice is 0."""

    @property
    def height(self) -> int:
        """Height, pixels."""
        return self._top + sum(self.heights) + sum(self._gaps) + BOTTOM

    def plotly(self) -> Json:
        """``data`` and ``layout`` for plotly."""
        data: list[Json] = []
        margin = {"l": self.sides[0], "r": self.sides[1], "t": self._top, "b": BOTTOM}
        layout: Json = {**LAYOUT, "height": self.height, "margin": margin, "shapes": [], "annotations": []}
        layout |= {"showlegend": self.legend, "legend": {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"}}
        layout["legend"] |= {"itemsizing": "constant"}
        number, named = 0, set[str]()
        count = sum(map(len, self.rows))
        for row, panels in enumerate(self.rows):
            for column, panel in enumerate(panels):
                number += 1
                wide, high = self._domain(row, column, len(panels))
                layout |= self._axes(panel, number, count, wide, high)
                layout["shapes"] += [_placed(mark, number) for mark in panel.marks if "text" not in mark]
                layout["annotations"] += [_placed(mark, number) for mark in panel.marks if "text" in mark]
                layout["annotations"] += [_title(panel.title, wide[0], high[1])] * bool(panel.title)
                for trace in panel.traces:
                    name = trace.get("name", "")
                    in_legend = bool(name) and (self.own_legends or name not in named)
                    named.add(name)
                    own = {"legend": _numbered("legend", number)} if self.own_legends else {"legendgroup": name}
                    data.append({**trace, **own, "showlegend": in_legend, "xaxis": f"x{number}", "yaxis": f"y{number}"})
                if self.own_legends:
                    layout[_numbered("legend", number)] = {"y": high[1], "yanchor": "top", "font": {"size": 10}}
        return {"data": data, "layout": layout | self.layout}

    def html(self) -> Html:
        """Markup with the packed figure; page.js draws it when it first becomes visible."""
        text = pack(json.dumps(self.plotly(), allow_nan=False, separators=(",", ":")))
        state = "" if self.when is None else f" data-{self.when[0]}={self.when[1]}" + " hidden" * (self.when[1] > 0)
        return Html(
            f'<figure class=figure role=img aria-label="{escape(self.label)}"{state} style="height:{self.height}px">'
            f"<script type=text/plain>{text}</script></figure>"
        )

    @property
    def _top(self) -> int:
        titled = bool(self.rows) and any(panel.title for panel in self.rows[0])
        return TOP + LEGEND * (self.legend and not self.own_legends) + LEGEND * titled

    @property
    def _gaps(self) -> list[int]:
        """Gap, pixels, below each row but the last."""
        gaps = []
        for upper, lower in zip(self.rows, self.rows[1:], strict=False):
            labelled = self.shared != "x" and any(panel.x.labels for panel in upper)
            titled = any(panel.title for panel in lower)
            gaps.append((TITLED_GAP if labelled else GAP) + LEGEND * titled)
        return gaps

    def _domain(self, row: int, column: int, columns: int) -> tuple[list[float], list[float]]:
        """Horizontal and vertical extent of a panel, as shares of the figure within its margins."""
        inner = sum(self.heights) + sum(self._gaps)
        top = inner - sum(self.heights[:row]) - sum(self._gaps[:row])
        width = (1 - COLUMN_GAP * (columns - 1)) / columns
        left = column * (width + COLUMN_GAP)
        return [left, left + width], [max(0.0, (top - self.heights[row]) / inner), top / inner]

    def _axes(self, panel: Panel, number: int, count: int, wide: list[float], high: list[float]) -> Json:
        x = panel.x.layout() | {"domain": wide, "anchor": f"y{number}"}
        y = panel.y.layout() | {"domain": high, "anchor": f"x{number}"}
        if self.shared == "x" and number < count:
            x |= {"matches": f"x{count}", "showticklabels": False, "title": None}
        if self.shared == "y" and number > 1:
            y |= {"matches": "y", "showticklabels": False, "title": None}
        return {_numbered("xaxis", number): x, _numbered("yaxis", number): y}


def over_time(label: str, rows: Sequence[Sequence[Panel]]) -> Figure:
    """Panels one below the other on a common time axis, each with its own legend."""
    heights = [OVER_TIME] * len(rows)
    return Figure(label, rows, heights, "x", own_legends=True, sides=(70, 190), layout={"hovermode": "x unified"})


def pack(text: str) -> str:
    """Text as gzip in base64, a third of the size; page.js unpacks it."""
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()


def _numbered(name: str, number: int) -> str:
    return name if number == 1 else f"{name}{number}"


def _placed(mark: Json, number: int) -> Json:
    """A mark on the axes of its panel."""
    own = {key: mark[key].replace(key[0], _numbered(key[0], number), 1) for key in ("xref", "yref")}
    return {**mark, **own}


def _title(text: str, left: float, top: float) -> Json:
    position = {"xref": "paper", "yref": "paper", "x": left, "y": top, "xanchor": "left", "yanchor": "bottom"}
    return {**position, "text": f"<b>{escape(text)}</b>", "showarrow": False}
