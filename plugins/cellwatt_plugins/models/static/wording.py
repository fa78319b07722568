"""The table of the methods, and the other results of a training, for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from cellwatt.report.blocks import Table
from cellwatt.report.numbers import fixed
from cellwatt_plugins.models.static.training import COVERAGE, PUBLISHED, Method, Trained

TITLES: Final = {
    "gravity": "gravity of the CAD model",
    "network": "network of the angles",
    "hybrid": "network on top of gravity",
    "best": "best model",
}


def in_words(trained: Trained, files: Sequence[Path]) -> str:
    """The whole report."""
    best, widths = trained.scores, trained.widths
    lines = [
        f"{len(trained.poses)} poses; absolute sum of the torques on the fifth that was held out of all methods "
        "(published figures in brackets)",
        rivals(trained).text(),
        f"Best model, each pose held out once: RMSE {best.rmse:.2f} Nm, R² {best.r2:.5f}, MAPE {best.mape:.2f} %; "
        f"{trained.scatter:.2f} Nm is the scatter of a pose.",
        f"{100 * COVERAGE:.0f} % of new poses within ± {widths.known:.2f} Nm, ± {widths.blind:.2f} Nm if the side of "
        "approach is not given.",
        "Effects that the CAD model lacks:",
    ]
    lines += [f"  • {finding.statement}" for finding in trained.findings]
    lines += [*trained.left_out, *(f"note: {note}" for note in trained.poses.notes)]
    return "\n".join([*lines, f"written: {', '.join(map(str, files))}"])


def rivals(trained: Trained) -> Table:
    """The errors of all methods, the published ones in brackets."""
    heads = ("method", "neurons", "RMSE, Nm", "R²", "MAPE, %", "accuracy, %")
    return Table("Methods", heads, [_method(method) for method in trained.methods])


def _method(method: Method) -> list[str]:
    scores = method.scores
    published = PUBLISHED.get(method.name)
    known = [""] * 3 if published is None else [f" ({value:g})" for value in published]
    cells = (fixed(scores.rmse, 2), fixed(scores.r2, 4), fixed(scores.mape, 2))
    neurons = "–" if method.neurons is None else str(method.neurons)
    with_published = [cell + paper for cell, paper in zip(cells, known, strict=True)]
    return [TITLES[method.name], neurons, *with_published, fixed(scores.accuracy, 2)]
