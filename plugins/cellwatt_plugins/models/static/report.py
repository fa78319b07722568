"""The page of ``train static``: predictions and measurements, compared methods, the figures."""

from __future__ import annotations

import numpy as np

from cellwatt.report import Axis, Bars, Figure, Notes, Panel, Provenance, Report, Section, Table, Tile
from cellwatt.report.drawing import band, dots, line
from cellwatt.report.numbers import measured, number
from cellwatt.report.theme import MEASURED, MODEL, NOISE
from cellwatt_plugins.models.report import residuals_by_joint
from cellwatt_plugins.models.static.training import COVERAGE, Trained
from cellwatt_plugins.models.static.wording import TITLES, rivals

SEEN = "Held-out poses. Band: {share:.0f} % of new poses lie within ± {width:.2f} Nm."
RIVALS = "On the fifth of the poses that was held out of all methods; in brackets the published figures."


def report(trained: Trained, robot: str, provenance: Provenance) -> Report:
    """The page of a training."""
    best = trained.scores
    roles = {"gravity": "simulation", "hybrid": "refit", "best": "model"}
    bars = [(TITLES[m.name], roles.get(m.name, "measured"), m.scores.rmse) for m in trained.methods]
    seen = SEEN.format(share=100 * COVERAGE, width=trained.widths.known)
    noise = trained.checked.model.posterior.noise
    statements = [*(finding.statement for finding in trained.findings), *trained.left_out]
    facts = "Standard deviations after ±; evidence: natural log of the factor by which the data get more probable."
    return Report(
        name=robot,
        subject="torque to hold still",
        facts=["torque to hold still", f"{len(trained.poses)} poses", f"{len(noise)} joints"],
        verdict=f"Held-out poses are predicted to {best.rmse:.2f} Nm, {best.mape:.2f} %; "
        f"{trained.scatter:.2f} Nm is the scatter of a pose.",
        tiles=[
            Tile(TITLES[m.name], f"{m.scores.rmse:.2f} Nm", f"{m.scores.mape:.2f} %", roles[m.name])
            for m in trained.methods
            if m.name in roles
        ],
        tiles_remark="RMSE of the absolute sum of the torques on poses that were held out of all methods.",
        sections=[
            Section("Measured and predicted", [_predicted(trained)], seen),
            Section(
                "Residual of each joint", [_residuals(trained)], "Nm over the joint's position. Band: ± 2 × noise."
            ),
            Section("Methods", [Bars(bars, "Nm"), rivals(trained)], RIVALS),
            Section("Effects that the CAD model lacks", [_figures(trained), Notes(statements)], facts),
            Section("Notes", [Notes(trained.poses.notes)]),
        ],
        provenance=provenance,
    )


def _predicted(trained: Trained) -> Figure:
    """Predicted over measured sums, and their difference."""
    total, predicted = trained.poses.total, trained.checked.predicted
    ends = np.array([total.min(), total.max()])
    x = Axis("measured, Nm")
    left = Panel(
        [line("equal", ends, ends, MEASURED, dash="dash"), dots("pose", total, predicted, MODEL)],
        x,
        Axis("predicted, Nm"),
    )
    width = trained.widths.known
    right = Panel(
        [dots("pose", total, total - predicted, MODEL)], x, Axis("difference, Nm"), band(-width, width, NOISE)
    )
    label = "Absolute sum of the torques: predicted over measured, and their difference"
    return Figure(label, [[left, right]], (280,), legend=False)


def _residuals(trained: Trained) -> Figure:
    """Measured minus modelled torque of each joint over its position."""
    bands = [band(-2 * noise, 2 * noise, NOISE) for noise in trained.checked.model.posterior.noise]
    label = "Residual of each joint over its position"
    return residuals_by_joint(label, "pose", trained.poses.q, trained.residual, ("rad", "Nm"), bands)


def _figures(trained: Trained) -> Table:
    """Every figure of the findings with its standard deviation."""
    rows = [
        [
            finding.kind,
            ", ".join(map(str, finding.joints)) or "all",
            figure.name,
            measured(figure.value, figure.deviation),
            figure.unit,
            "–" if finding.evidence is None else number(finding.evidence),
        ]
        for finding in trained.findings
        for figure in finding.figures
    ]
    return Table("Figures of the arm", ("effect", "joint", "figure", "value", "unit", "evidence"), rows)
