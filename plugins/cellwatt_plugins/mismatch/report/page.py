"""The page put together: one file below 5 MB that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

import numpy as np

from cellwatt.errors import CellwattError, why
from cellwatt_plugins.mismatch.input.run import Float
from cellwatt_plugins.mismatch.report import cards
from cellwatt_plugins.mismatch.report.trace import Trace
from cellwatt_plugins.mismatch.verdict.findings import Findings

MOST_NAMES = 6
"""Recordings named at the top; more are counted."""
TRIED = "Evidence that each candidate adds, in nats (5 nats are odds of 150 to 1); bars on a logarithmic scale."
FOOT = (
    "<footer>Beside this page: <b>findings.json</b>, the same for programs; <b>model.yaml</b>, the model, "
    "run with <code>cellwatt simulate --model model.yaml</code>.</footer>"
)


def write_report(path: Path, findings: Findings, traces: Sequence[Trace], robot: str, noise_floor: Float) -> None:
    """Write the page to ``path``.

    ``noise_floor`` (C,) belongs to the channels of the first trace, NaN where none is known; ``robot`` is its name.
    Raises ``CellwattError`` where plotly is not installed or the file cannot be written.
    """
    floors = _floors(traces, noise_floor)
    drawn = [t for t in traces if len(t.time)]
    figures, engine = _figures(findings, drawn, floors)
    body = "".join(
        [
            _head(robot, traces),
            cards.banner(findings),
            cards.section("What was found", "", cards.found(findings)),
            cards.section(
                "Channels", "Held-out rms error; dots on a scale of noise floors.", cards.fit_table(findings.fit)
            ),
            figures,
            cards.section("What was tried", TRIED, cards.trials(findings.tried)),
            cards.section("What the data could not tell", "", cards.notes(findings.notes)),
            FOOT,
        ]
    )
    text = (
        '<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content="width=device-width">'
        f"<title>{escape(robot)}: simulation and recordings</title><style>{_part('page.css')}</style>"
        f"<main>{body}</main>{engine}<script>{_part('page.js')}</script></html>"
    )
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CellwattError(f"cannot write the report {path}: {why(error)}") from error


def _floors(traces: Sequence[Trace], noise_floor: Float) -> dict[str, float]:
    """Channel → noise floor, NaN where none is known."""
    if not traces:
        return {}
    if len(noise_floor) != len(traces[0].channels):
        raise ValueError(f"{len(noise_floor)} noise floors for {len(traces[0].channels)} channels")
    floors = zip(traces[0].channels, noise_floor, strict=True)
    return {c: float(f) if np.isfinite(f) and f > 0 else float("nan") for c, f in floors}


def _figures(findings: Findings, traces: Sequence[Trace], floors: dict[str, float]) -> tuple[str, str]:
    """The drawn sections, and what draws them."""
    try:
        from cellwatt_plugins.mismatch.report import figures
    except ImportError as error:
        raise CellwattError("the report needs plotly: pip install 'cellwatt[plot]'") from error
    return (figures.sections(findings, traces, floors), figures.engine()) if traces else ("", "")


def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _head(robot: str, traces: Sequence[Trace]) -> str:
    names = [t.name for t in traces]
    shown = ", ".join(names[:MOST_NAMES]) + (f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else "")
    rates = sorted({round(1 / t.step, 1) for t in traces if t.step > 0})
    facts = [f"{len(names)} recording{'s' * (len(names) != 1)} ({shown})"] if names else []
    facts += [f"{sum(len(t.time) * t.step for t in traces):.0f} s"] if rates else []
    facts += [f"{' and '.join(f'{r:g}' for r in rates)} Hz"] if rates else []
    return f"<header class=top><b>{escape(robot)}</b> <span>{escape(' · '.join(facts))}</span></header>"
