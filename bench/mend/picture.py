"""Errors on sealed motion as bars, one group an arm."""

from __future__ import annotations

import math
from typing import Any

COLOURS = {"before": "#90a4ae", "sysid": "#e53935", "mended": "#1e88e5", "model": "#43a047", "floor": "#37474f"}
NAMES = {
    "before": "user's file",
    "sysid": "mujoco.sysid",
    "mended": "mended",
    "model": "model.yaml",
    "floor": "best possible",
}
WIDTH, LEFT, BAR, GAP, TOP = 760, 190, 13, 18, 44


def picture(figures: dict[str, Any]) -> str:
    """SVG: torque error in units of the noise, logarithmic from 1."""
    most = max(value for x in figures.values() for value in x["in_noise"].values())
    scale = (WIDTH - LEFT - 60) / math.log10(1.15 * most)
    rows, y = [], TOP
    for name, x in figures.items():
        shown = [m for m in COLOURS if m in x["in_noise"]]
        middle = y + len(shown) * BAR / 2 + 4
        rows.append(f'<text x="{LEFT - 10}" y="{middle:.0f}" text-anchor="end">{name}</text>')
        for m in shown:
            value = x["in_noise"][m]
            length = max(1.0, scale * math.log10(value))
            rows.append(f'<rect x="{LEFT}" y="{y}" width="{length:.1f}" height="{BAR - 2}" fill="{COLOURS[m]}"/>')
            rows.append(f'<text x="{LEFT + length + 5:.1f}" y="{y + BAR - 3}" font-size="11">{value:.2f}</text>')
            y += BAR
        y += GAP
    legend, at = [], LEFT
    for m, name in NAMES.items():
        if not any(m in x["in_noise"] for x in figures.values()):
            continue
        legend.append(f'<rect x="{at}" y="13" width="14" height="8" fill="{COLOURS[m]}"/>')
        legend.append(f'<text x="{at + 19}" y="21">{name}</text>')
        at += 40 + 7 * len(name)
    below = f'<text x="{LEFT}" y="{y + 12}">error of the torque on sealed motion / noise (logarithmic from 1)</text>'
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y + 24}" width="{WIDTH}" height="{y + 24}" '
        'font-family="Helvetica,Arial,sans-serif" font-size="12" fill="#37474f">'
    )
    return "\n".join(
        [head, f'<rect width="{WIDTH}" height="{y + 24}" fill="#ffffff"/>', *legend, *rows, below, "</svg>\n"]
    )
