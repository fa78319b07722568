"""The page of ``explain``: below 5 MB."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from cellwatt.report import Html, Notes, Provenance, Report, Section
from cellwatt.report.page import Tone
from cellwatt_plugins.explain.report import cards, falls, figures, wording
from cellwatt_plugins.explain.report.trace import Trace
from cellwatt_plugins.explain.verdict.findings import Findings

MOST_NAMES = 6
"""Largest number of recordings named at the top; further ones are counted."""
TRIED = "Evidence that each candidate adds, in nats (5 nats are odds of 150 to 1); bars on a logarithmic scale."
OTHERS = "Not used for fitting; the usual error is that on data left out of the fit. Worst first."
BESIDE = Html(
    "<p>Beside this page: <b>findings.json</b>, the same content for programs; <b>model.yaml</b>, the model, "
    "run with <code>cellwatt simulate --model model.yaml</code>.</p>"
)
TONES: Final[dict[str, Tone]] = {
    "no_mismatch": "good",
    "explained": "found",
    "partly_explained": "part",
    "unexplained": "open",
}


def report(
    findings: Findings,
    traces: Sequence[Trace],
    robot: str,
    floors: Mapping[str, float],
    provenance: Provenance,
    moved: Sequence[Section] = (),
) -> Report:
    """The page with the findings.

    ``floors`` are the noise floors of all channels by name; ``robot`` is the robot's name; ``moved`` are sections on
    its motion.
    """
    return Report(
        name=robot,
        subject="simulation and recordings",
        facts=_facts(traces, len(findings.others)),
        verdict=wording.verdict(findings),
        tone=TONES[findings.verdict],
        badge=findings.verdict.replace("_", " "),
        tiles=cards.tiles(findings.fit),
        tiles_remark="Error of the worst channel on data not used for fitting. 1× is sensor noise, the best possible.",
        sections=[
            falls.numbers(findings),
            falls.section(findings),
            *moved,
            Section("What was found", cards.found(findings)),
            Section("What the residual follows", [Notes([curve.statement for curve in findings.curves])]),
            *figures.sections(findings, traces, floors),
            Section("Other recordings", cards.others_table(findings.others), OTHERS),
            Section("What was tried", cards.trials(findings.tried), TRIED),
            Section("What the data could not show", [Notes(findings.notes)]),
        ],
        beside=BESIDE,
        provenance=provenance,
    )


def _facts(traces: Sequence[Trace], others: int) -> list[str]:
    """Number, length and rate of the analysed recordings, and the number of ``others``."""
    names = [t.name for t in traces]
    shown = ", ".join(names[:MOST_NAMES]) + (f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else "")
    rates = sorted({round(1 / t.step, 1) for t in traces})
    facts = [
        f"{len(names)} recording{'s' * (len(names) != 1)} ({shown})",
        f"{sum(len(t.time) * t.step for t in traces):.0f} s",
        f"{' and '.join(f'{r:g}' for r in rates)} Hz",
    ]
    return facts + ([f"{others} more compared with the model"] if others else [])
