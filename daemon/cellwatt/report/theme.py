"""Colours and fonts of every page and figure.

Text in figures takes the page's colour from the style sheet, so that one drawing serves light and dark mode.
"""

from __future__ import annotations

from typing import Any, Final

MEASURED, SIMULATION, REFIT, MODEL = "#7d8794", "#e07b39", "#9a6fc4", "#2f86d1"
NOISE, FOUND, CURVE = "#8a939e", "#d9a400", "#b3123f"
GOOD, BAD, PALE = "#2b8a57", "#c0392b", "#7fb2dd"
SERIES: Final = (MODEL, SIMULATION, GOOD, BAD, "#3aa5a0", REFIT, "#d0699a", "#9d755d")
"""Colours of curves that differ only in their number."""
ROLES: Final = {
    "measured": MEASURED,
    "simulation": SIMULATION,
    "refit": REFIT,
    "model": MODEL,
    "good": GOOD,
    "bad": BAD,
}
"""Names of colours in the style sheet: ``--model``, and ``i.model`` for its mark."""
HEAT: Final = (
    (0.0, "rgba(128,140,150,0.16)"),
    (0.12, "rgba(150,150,140,0.28)"),
    (0.35, "rgba(244,184,96,0.75)"),
    (0.65, "rgba(226,98,60,0.95)"),
    (1.0, "rgba(150,20,60,1)"),
)
"""Colour scale, from 0 to the largest value."""
CLEAR: Final = "rgba(0,0,0,0)"
LAYOUT: Final[dict[str, Any]] = {
    "template": "none",
    "paper_bgcolor": CLEAR,
    "plot_bgcolor": CLEAR,
    "font": {"family": "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif", "size": 12},
    "hoverlabel": {"font": {"size": 12}},
}
GRID: Final[dict[str, Any]] = {"gridcolor": "rgba(128,128,128,0.2)", "zerolinecolor": "rgba(128,128,128,0.45)"}


def custom_properties() -> str:
    """Style sheet text: the roles as custom properties, and their marks."""
    colours = "".join(f"--{name}:{colour};" for name, colour in ROLES.items())
    return f":root{{{colours}}}" + "".join(f"i.{name}{{background:var(--{name})}}" for name in ROLES)
