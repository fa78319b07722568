"""The cascade as bars that fall to the noise, and as a table of channels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from cellwatt.report import Bars, Section, Table
from cellwatt.report.numbers import capital, decimals_for, fixed, measured, number, unit
from cellwatt_plugins.explain.report import wording
from cellwatt_plugins.explain.verdict.findings import Finding, Findings, RetunedNumber, Step

LEAD = (
    "Error of a typical channel after each step (geometric mean over all channels), on data not used for fitting. "
    "1× is sensor noise, the best possible. Each step adds one finding to your unchanged simulation; only the last "
    "step changes the numbers of your simulation."
)
COLUMNS = ("in your simulation", "on your arm, ± one standard deviation")
CENTRE = ("com_x", "com_y", "com_z")
ROLES = {"simulation": "simulation", "finding": "model", "curve": "model", "retuning": "refit"}


class NumberRow(NamedTuple):
    """A parameter of the arm as a row of text."""

    name: str
    was: str
    """Value in the simulation."""
    now: str
    """Value on the arm."""
    remark: str


def section(findings: Findings) -> Section:
    """The steps from the user's simulation to the model; empty without a cascade."""
    steps = findings.cascade
    if not steps:
        return Section("What takes the error away", [])
    rows = [(label(step, first=i == 0), ROLES[step.kind], step.error) for i, step in enumerate(steps)]
    return Section("What takes the error away", [Bars(rows, "× noise", 1.0), _channels(findings)], LEAD)


def numbers(findings: Findings) -> Section:
    """Each parameter that is found or retuned: in the simulation, and on the arm."""
    rows = number_rows(findings)
    table = Table("Numbers", ("number", *COLUMNS, ""), rows)
    return Section("Your simulation in numbers", [table] if rows else [])


def number_rows(findings: Findings) -> list[NumberRow]:
    """Each parameter that is found, then each that is retuned; a centre of mass is one row."""
    rows = [row for f in findings.findings if f.followed for row in _found(f)]
    return [*rows, *(_retuned(moved) for moved in findings.retuned)]


def _found(finding: Finding) -> Iterator[NumberRow]:
    name = capital(wording.named(finding))
    remark = {"mistuned": "off beyond its tolerance", "structure": "built differently"}.get(finding.kind, "missing")
    for i, (word, parameter) in enumerate(finding.parameters.items()):
        symbol, known = unit(parameter.unit), finding.was if i == 0 else None
        if known is not None:
            now = f"{measured(known + parameter.value, parameter.std)} {symbol}"
            yield NumberRow(name, f"{number(known)} {symbol}", now, remark)
        elif word not in CENTRE:
            now = f"{measured(parameter.value, parameter.std)} {symbol}"
            yield NumberRow(f"{name}: {word.replace('_', ' ')}", "not in it", now.rstrip(), remark)
    centre = [finding.parameters[word] for word in CENTRE if word in finding.parameters]
    if centre:
        std = max(p.std for p in centre)
        place = ", ".join(fixed(p.value, decimals_for(std, 1)) for p in centre)
        yield NumberRow(f"{name}: centre of mass", "not in it", f"({place}) ± {number(std, 1)} m", remark)


def _retuned(moved: RetunedNumber) -> NumberRow:
    owner = "link" if moved.parameter.startswith(("mass", "com", "i")) else "joint"
    place = "" if moved.joint is None else f" of {owner} {moved.joint}"
    name = moved.parameter.replace("com_", "centre of mass along ")
    symbol = unit(moved.unit)
    allowed = "beyond" if moved.beyond else "within"
    return NumberRow(
        capital(f"{wording.effect_name(name)}{place}"),
        f"{number(moved.was)} {symbol}",
        f"{measured(moved.now, moved.std)} {symbol}",
        f"retuned {allowed} your ± {number(moved.tolerance, 2)} {symbol}",
    )


def label(step: Step, first: bool) -> str:
    """Label of a step: the simulation, then each added finding."""
    if step.kind == "finding" and step.effect:
        place = "" if step.joint is None else f" of joint {step.joint}"
        return f"+ {wording.effect_name(step.effect)}{place}"
    return capital(step.label) if first else f"+ {step.label}"


def _channels(findings: Findings) -> Table:
    """Rms error of each channel after each step, in its own unit."""
    fit = [f for f in findings.fit if f.channel in findings.cascade[0].channels]
    heads = [f"{wording.channel_name(f.channel)}, {unit(f.unit)}" for f in fit]
    digits = [decimals_for(f.noise_floor) for f in fit]
    rows = [
        [label(step, i == 0), *(fixed(step.channels[f.channel], d) for f, d in zip(fit, digits, strict=True))]
        for i, step in enumerate(findings.cascade)
    ]
    rows.append(["Noise", *(fixed(f.noise_floor, d) for f, d in zip(fit, digits, strict=True))])
    return Table("Error of each channel after each step", ["step", *heads], rows)
