"""The figure on the pages of both trainings: a model's residuals at each joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cellwatt.arrays import Float
from cellwatt.report import Axis, Figure, Panel
from cellwatt.report.drawing import dots
from cellwatt.report.theme import MODEL

ACROSS = 3
"""Number of joints side by side."""


def residuals_by_joint(
    label: str, name: str, x: Float, residual: Float, units: tuple[str, str], bands: Sequence[list[dict[str, Any]]] = ()
) -> Figure:
    """The ``residual`` (N, n) of each joint over its ``x`` (N, n), in their ``units``, each panel with a band."""
    panels = [
        Panel(
            [dots(name, x[:, j], residual[:, j], MODEL)],
            Axis(units[0]),
            Axis(units[1] if j % ACROSS == 0 else ""),
            bands[j] if bands else (),
            f"joint {j + 1}",
        )
        for j in range(x.shape[1])
    ]
    rows = [panels[i : i + ACROSS] for i in range(0, len(panels), ACROSS)]
    return Figure(label, rows, [170] * len(rows), legend=False)
