"""What all figures share; text takes the page's colour by style sheet, so that light and dark need one drawing."""

from __future__ import annotations

from typing import Any

MEASURED, SIMULATION, MODEL, NOISE, FOUND = "#7d8794", "#e07b39", "#2f86d1", "#8a939e", "#d9a400"
CLEAR = "rgba(0,0,0,0)"
BARE: dict[str, Any] = {
    "template": "none",
    "paper_bgcolor": CLEAR,
    "plot_bgcolor": CLEAR,
    "font": {"family": "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif", "size": 12},
    "hoverlabel": {"font": {"size": 12}},
}
"""Layout of every figure."""
GRID: dict[str, Any] = {"gridcolor": "rgba(128,128,128,0.2)", "zerolinecolor": "rgba(128,128,128,0.45)", "ticks": ""}
"""Of every axis."""
