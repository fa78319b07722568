"""Report pages: one HTML file with figures, tables and text, in the same style for every command.

A page is a ``Report`` of ``Section`` with blocks: texts, ``Figure``, ``Table``, ``Card``, ``Bars``, ``Notes`` …
"""

from cellwatt.report.blocks import Bars, Block, Card, Columns, Folded, Html, Notes, Switch, Table, heading, quiet
from cellwatt.report.figure import Axis, Figure, Panel, over_time
from cellwatt.report.page import Report, Section, Tile
from cellwatt.report.provenance import Provenance

__all__ = [
    "Axis",
    "Bars",
    "Block",
    "Card",
    "Columns",
    "Figure",
    "Folded",
    "Html",
    "Notes",
    "Panel",
    "Provenance",
    "Report",
    "Section",
    "Switch",
    "Table",
    "Tile",
    "heading",
    "over_time",
    "quiet",
]
