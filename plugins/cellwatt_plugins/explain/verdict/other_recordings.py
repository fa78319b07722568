"""Recordings that were not used for fitting: does the model explain them, too?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwatt.errors import RecordingError
from cellwatt.scheduler import spread
from cellwatt_plugins.explain.input.admission import check_run
from cellwatt_plugins.explain.input.reading import read_sources
from cellwatt_plugins.explain.input.sources import Source
from cellwatt_plugins.explain.model import Model, predict_states
from cellwatt_plugins.explain.verdict.findings import Findings, Other
from cellwatt_plugins.robot.meter.held import held

FACTOR = 2.0
"""Error relative to that on data left out of the fit above which a recording is not explained."""
NAMED = 5
"""Largest number of recordings named in notes; ``findings.json`` and the report list all."""


def compare(
    files: Sequence[Source], findings: Findings, model: Model, simulator: Path | None, rate: float
) -> tuple[Other, ...]:
    """Compare each recording with the model, at ``rate`` Hz."""
    usual = {fit.channel: max(fit.model, fit.noise_floor) for fit in findings.fit}
    known = model, simulator, rate, usual
    return tuple(spread(_compared, files, "comparing the other recordings", shared=known))


def with_others(findings: Findings, others: Sequence[Other], close: int) -> Findings:
    """The findings from ``close`` recordings, with the comparison of the others added."""
    if not others:
        return findings
    odd = [other for other in others if other.explained is False]
    notes = (_summary(others, len(odd), close), *(_odd(other) for other in odd[:NAMED]))
    left_out = tuple(f"{other.recording} was not compared: {other.why}" for other in others if other.explained is None)
    verdict = findings.verdict
    if odd:
        verdict = "partly_explained" if any(f.effect != "unknown" for f in findings.findings) else "unexplained"
    return replace(findings, verdict=verdict, others=tuple(others), notes=(*findings.notes, *notes, *left_out[:NAMED]))


def _summary(others: Sequence[Other], odd: int, close: int) -> str:
    return f"{close} of {close + len(others)} recordings, those whose motions differ most, were looked at closely; " + (
        f"{odd} of the others differ{'s' * (odd == 1)} from the findings"
        if odd
        else "the others agree with the findings"
        if any(other.explained for other in others)
        else "no other one was compared"
    )


def _odd(other: Other) -> str:
    return (
        f"{other.recording}: {other.channel} is off by {other.error:.3g} {other.unit.replace('*', '')} rms, "
        f"{other.error / other.usual:.1f} times as much as elsewhere: explain this recording by itself"
    )


def _compared(file: Source, known: tuple[Model, Path | None, float, dict[str, float]]) -> Other:
    """The channel of a recording that deviates most from the model; ``usual`` is each channel's error on data left
    out."""
    model, simulator, rate, usual = known
    try:
        runs = read_sources([file], model.robot, simulator, rate)
        moved = [check_run(run, model.baseline.arm) for run in runs]
    except RecordingError as error:
        return Other(file.name, None, why=str(error))
    if runs[0].drive is not None:
        return Other(file.name, None, why="no torque was recorded, and the model has no gains of its drives")
    found = []
    for run, motion in zip(runs, moved, strict=True):
        predicted = predict_states(model, model.baseline.states(run, motion))
        parts = [
            (f"tau_{i + 1}", model.robot.unit(i, "N*m"), run.torque[:, i], predicted.torque[:, i])
            for i in range(run.joints)
        ]
        if run.power is not None and held([(run.time, run.power)]) is None:
            parts.append(("power", "W", run.power, predicted.power))
        for name, unit, measured, modelled in parts:
            read = np.isfinite(measured) & ~run.filled
            if name in usual and read.any():
                off = float(np.sqrt(np.mean(np.square(measured - modelled)[read])))
                # Unexplained is an error above both the usual one and the share of the measured values that matters.
                most = max(FACTOR * usual[name], model.robot.tolerances.unexplained * float(np.std(measured[read])))
                found.append(Other(run.name, off < most, name, unit, off, usual[name]))
    if not found:
        return Other(file.name, None, why="it has no channel that was explained in the other recordings")
    return max(found, key=lambda other: (other.explained is False, other.error / other.usual))
