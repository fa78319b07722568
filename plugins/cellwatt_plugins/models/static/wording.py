"""The table of the methods, and what else a training has to say, for a person at the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from cellwatt_plugins.models.static.conformal import COVERAGE
from cellwatt_plugins.models.static.training import PUBLISHED, Method, Trained

TITLES: Final = {
    "gravity": "gravity of the CAD model",
    "network": "network, 6 angles",
    "hybrid": "network on top of gravity",
    "best": "best model",
}


def in_words(trained: Trained, files: Sequence[Path]) -> str:
    """The whole report."""
    best, widths = trained.scores, trained.widths
    lines = [
        f"{len(trained.poses)} poses; absolute sum of the torques on the fifth of them that no method had seen "
        "(published figures in brackets):",
        f"{'':34}{'RMSE':>18}{'R²':>18}{'MAPE':>18}{'accuracy':>12}",
        *(_row(method) for method in trained.methods),
        f"Best model, every pose left out once: RMSE {best.rmse:.2f} Nm, R² {best.r2:.5f}, MAPE {best.mape:.2f} %.",
        f"{100 * COVERAGE:.0f} % of new poses within ± {widths.told:.2f} Nm, ± {widths.blind:.2f} Nm where it is not "
        "told from where the arm came.",
        trained.curve.in_words(),
    ]
    lines.append("What the arm has and its CAD model lacks:")
    lines += [f"  • {finding.statement}" for finding in trained.findings]
    if (odd := np.unique(np.argwhere(trained.checked.model.odd)[:, 0])).size:
        lines.append(f"Not used, as they fit nothing else: torques in pose {', '.join(str(p + 1) for p in odd)}.")
    lines += [f"note: {note}" for note in trained.poses.notes]
    lines.append(f"written: {', '.join(map(str, files))}")
    return "\n".join(lines)


def _row(method: Method) -> str:
    scores = method.scores
    rmse, r2, mape = PUBLISHED.get(method.name, (None, None, None))
    title = TITLES[method.name] + (f" ({method.neurons})" if method.neurons else "")
    cells = (
        f"{scores.rmse:.2f} Nm" + ("" if rmse is None else f" ({rmse:.2f})"),
        f"{scores.r2:.4f}" + ("" if r2 is None else f" ({r2:.3f})"),
        f"{scores.mape:.2f} %" + ("" if mape is None else f" ({mape:.1f})"),
    )
    return f"{title:<34}{cells[0]:>18}{cells[1]:>18}{cells[2]:>18}{scores.accuracy:>10.2f} %"
