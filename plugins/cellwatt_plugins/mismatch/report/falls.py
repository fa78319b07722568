"""The cascade as bars that fall to the noise, and as a table of channels."""

from __future__ import annotations

from cellwatt.report import Bars, Block, Folded, Section, Table
from cellwatt.report.numbers import capital, decimals_for, fixed, measured, number, unit
from cellwatt_plugins.mismatch.report import words
from cellwatt_plugins.mismatch.verdict.findings import Finding, Findings, Retuned, Step

LEAD = (
    "Error of a typical channel after each step (geometric mean over all channels), on data not used for fitting. "
    "1× is sensor noise, the best possible. Each step adds one finding to your simulation as it is; only the last step "
    "changes the numbers that your simulation has."
)
ROLES = {"simulation": "simulation", "finding": "model", "curve": "model", "retuning": "refit"}


def section(findings: Findings) -> Section:
    """From the user's simulation to the model; empty where no cascade was made."""
    steps = findings.cascade
    if not steps:
        return Section("What takes the error away", [])
    rows = [(label(step, first=i == 0), ROLES[step.kind], step.error) for i, step in enumerate(steps)]
    blocks: list[Block] = [Bars(rows, "× noise", 1.0), Folded("Step by step, each channel", [_channels(findings)])]
    return Section("What takes the error away", blocks, LEAD)


def numbers(findings: Findings) -> Section:
    """Each number that is found or retuned: in the simulation, and on the arm."""
    rows = [row for f in findings.findings if f.effect != words.UNKNOWN for row in _found(f)]
    for moved in findings.retuned:
        name = f"{words.effect_name(moved.parameter)}{_place(moved.parameter, moved.joint)}"
        was = f"{number(moved.was)} {unit(moved.unit)}"
        rows.append([capital(name), was, f"{measured(moved.now, moved.std)} {unit(moved.unit)}", _allowed(moved)])
    table = Table("Numbers", ("number", "in your simulation", "on your arm, ± one standard deviation", ""), rows)
    return Section("Your simulation in numbers", [table] if rows else [])


def _found(finding: Finding) -> list[list[str]]:
    rows = []
    for i, (name, parameter) in enumerate(finding.parameters.items()):
        symbol = unit(parameter.unit)
        known = finding.was if i == 0 else None
        was = "not in it" if known is None else f"{number(known)} {symbol}"
        now = f"{measured((known or 0.0) + parameter.value, parameter.std)} {symbol}"
        title = f"{capital(words.named(finding))}: {name.replace('_', ' ')}"
        rows.append([title, was, now, "mistuned" if finding.kind == "mistuned" else "missing"])
    return rows


def _place(parameter: str, joint: int | None) -> str:
    if joint is None:
        return ""
    return f" of {'link' if parameter.startswith(('mass', 'com', 'i')) else 'joint'} {joint}"


def _allowed(moved: Retuned) -> str:
    allowed = "beyond" if moved.beyond else "within"
    return f"retuned, {allowed} what you allow (± {number(moved.tolerance)} {unit(moved.unit)}, one standard deviation)"


def label(step: Step, first: bool) -> str:
    """A step as the page names it: the simulation, then what is added to it."""
    if step.kind == "finding" and step.effect:
        place = "" if step.joint is None else f" of joint {step.joint}"
        return f"+ {words.effect_name(step.effect)}{place}"
    return capital(step.label) if first else f"+ {step.label}"


def _channels(findings: Findings) -> Table:
    """Rms error of each channel after each step, in its own unit."""
    fit = [f for f in findings.fit if f.channel in findings.cascade[0].channels]
    heads = [f"{words.channel_name(f.channel)}, {unit(f.unit)}" for f in fit]
    digits = [decimals_for(f.noise_floor) for f in fit]
    rows = [
        [label(step, i == 0), *(fixed(step.channels[f.channel], d) for f, d in zip(fit, digits, strict=True))]
        for i, step in enumerate(findings.cascade)
    ]
    rows.append(["Noise", *(fixed(f.noise_floor, d) for f, d in zip(fit, digits, strict=True))])
    return Table("Error of each channel after each step", ["step", *heads], rows)
