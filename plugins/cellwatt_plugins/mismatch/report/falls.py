"""The cascade as bars that fall to the noise, and as a table of channels."""

from __future__ import annotations

from cellwatt.report import Bars, Block, Folded, Section, Table
from cellwatt.report.numbers import capital, decimals_for, fixed, unit
from cellwatt_plugins.mismatch.report import words
from cellwatt_plugins.mismatch.verdict.findings import Findings, Step

LEAD = (
    "Error after each step, on data not used for fitting: root mean square over all channels, each in units of its "
    "noise. Your numbers stay as they are until the last step, which retunes them within their tolerances."
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


def label(step: Step, first: bool) -> str:
    """A step as the page names it: the simulation, then what is added to it."""
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
