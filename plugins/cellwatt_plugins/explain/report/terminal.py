"""Findings for the terminal: parameters, then the error after each step, then each finding."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cellwatt_plugins.explain.explain import Explained
from cellwatt_plugins.explain.report.falls import NumberRow, label, number_rows
from cellwatt_plugins.explain.report.wording import effect_name, moments, verdict
from cellwatt_plugins.explain.verdict.findings import Findings, Step

BAR = 30
"""Length of the longest bar, in characters."""


def in_words(found: Explained, out: Path, report: bool) -> str:
    """The findings as text for the terminal, with the names of the files written to ``out``."""
    findings = found.findings
    with_curves = {curve.channel for curve in findings.curves}
    lines = [verdict(findings), *_numbers(findings), *_cascade(findings)]
    for finding in findings.findings:
        gain = finding.improvement
        times = finding.where.times if len(found.runs) > 1 else ()
        lines.append(f"  • {finding.statement}" + (f" In {moments(times)}." if times else ""))
        curved = " with the curves below" if not finding.followed and gain.channel in with_curves else ""
        held_out = "held-out " if gain.held_out else ""
        lines.append(
            f"      {gain.channel}: {held_out}error {gain.before:.3g} → {gain.after:.3g} "
            f"{gain.unit.replace('*', '')}{curved}, noise {gain.noise_floor:.3g}"
        )
        lines += [f"      or {effect_name(other.effect)}: {other.why}" for other in finding.alternatives]
    lines += [f"  ? {rest.statement}" for rest in findings.without_finding]
    lines += [f"  = {moved.statement}" for moved in findings.retuned]
    lines += [f"  ~ {curve.statement}" for curve in findings.curves]
    lines += [f"  note: {note}" for note in findings.notes]
    page = ", report.html" if report else ""
    return "\n".join([*lines, f"written to {out}: findings.json, model.yaml{page}"])


def _numbers(findings: Findings) -> list[str]:
    """Each parameter in the simulation and on the arm, in columns."""
    rows = number_rows(findings)
    if not rows:
        return []
    rows = [NumberRow("", "in your simulation", "on your arm", ""), *rows]
    name, was, now = (max(len(getattr(row, part)) for row in rows) for part in ("name", "was", "now"))
    return [f"  {row.name:<{name}}  {row.was:<{was}}  {row.now:<{now}}  {row.remark}".rstrip() for row in rows]


def _cascade(findings: Findings) -> list[str]:
    """The steps from the user's simulation to the model as bars that fall to the noise."""
    steps, units = findings.cascade, {f.channel: f.unit.replace("*", "") for f in findings.fit}
    if not steps:
        return []
    labels = [label(step, i == 0) for i, step in enumerate(steps)]
    top, wide = max(step.error for step in steps), max(map(len, labels))
    lines = ["  error of a typical channel in units of its noise, on data left out of the fit (1: noise alone):"]
    for name, before, step in zip(labels, (None, *steps), steps, strict=False):
        drawn = "█" * max(1, round(BAR * step.error / top))
        gone = "" if before is None else _fallen(before, step, units)
        lines.append(f"    {name:<{wide}} {step.error:6.1f}  {drawn:<{BAR}}  {gone}".rstrip())
    return lines


def _fallen(before: Step, after: Step, units: Mapping[str, str]) -> str:
    """The channel whose error falls most in a step, relative to its error before, with both errors."""
    channel = min(after.channels, key=lambda c: after.channels[c] / max(before.channels[c], 1e-12))
    return f"{channel} {before.channels[channel]:.3g} → {after.channels[channel]:.3g} {units.get(channel, '')}"
