"""The page put together: one file that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

import numpy as np

from cellwatt_plugins.energy.campaign import Outcome
from cellwatt_plugins.energy.drive import bus_power, supply_power
from cellwatt_plugins.energy.findings import Findings, RunEnergy
from cellwatt_plugins.energy.report import tables
from cellwatt_plugins.energy.report.svg import Bar, Line, over_time, stacked

GROUPS = {
    "electronics": "electronics",
    "brakes": "brakes",
    "mechanical": "mechanical losses",
    "electrical": "electrical losses",
    "chopper": "chopper",
}
CURVES = {
    "measured": "measured (dots), model of the supply (line)",
    "electronics": "electronics",
    "brakes": "electronics and brakes",
    "mechanical": "mechanical power",
    "electrical": "electrical losses and chopper",
}
OVER_TIME = (
    "The first repetition, and measured values of all. Each is a mean over the analyzer's interval: where power "
    "changes faster, dots lie inside the peaks."
)
JOINTS = (
    "Identified over all runs together: the factor on torque, resistance, switching and iron losses by measured power; "
    "friction (viscous, Coulomb, offset, windage) by the corrected torque."
)
PAPER_FASTEST = 250.0
"""mm/s: the fastest speed of the paper, drawn over time beside the fastest of the campaign."""


def write_report(outcome: Outcome, path: Path) -> None:
    """Write the page to ``path``. Raises ``OSError``."""
    found = outcome.findings
    body = "".join(
        [
            f"<header><b>{escape(found.robot)}</b> energy by consumer</header><h1>{escape(headline(found))}</h1>",
            _section("Fixed power", "Drawn whatever the robot does.", tables.fixed_table(found.robot, found.fixed)),
            _section("Average power of each run", "W, over one repetition.", _legend(GROUPS), _bars(found, "W")),
            _section("Share of each consumer", "Percent of the run's energy.", _legend(GROUPS), _bars(found, "%")),
            _section(
                "Over time",
                OVER_TIME,
                _legend(CURVES),
                *_curves(outcome),
            ),
            _section("Energies of one repetition", _columns_told(found), tables.run_table(found.runs)),
            _section("Payload efficiency", "ε_P = 100 (E_RL − E_RNL) / E_RL.", tables.payload_table(found))
            if found.payload_efficiency_percent
            else "",
            _section("Joints", JOINTS, tables.joint_table(found)),
            _notes(found),
        ]
    )
    style = files(__package__).joinpath("page.css").read_text(encoding="utf-8")
    path.write_text(
        '<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content="width=device-width">'
        f"<title>{escape(found.robot)}: energy by consumer</title><style>{style}</style><main>{body}</main></html>",
        encoding="utf-8",
    )


def headline(found: Findings) -> str:
    """State the main result in one sentence."""
    names = {
        "electronics": "electronics take",
        "brakes": "brakes take",
        "mechanical_losses": "friction takes",
        "electrical_losses_with_regeneration": "motors and drives take",
    }
    ranked = sorted(found.average_share_percent.items(), key=lambda item: -item[1])
    words = [f"{names[group]} {share:.0f} %" for group, share in ranked]
    return f"Of the mean power of these runs {words[0]}, {words[1]}, {words[2]} and {words[3]}."


def _columns_told(found: Findings) -> str:
    share = f"{100 * found.returned:.0f} ± {tables.unsure(100 * found.returned_uncertainty)} %"
    return (
        "J with one standard deviation, and percent of the total. L_E* = L_E + E_RB; “at most” is the negative "
        f"mechanical energy that ECDP takes for E_RB. Of what the motors give back to the bus the electronics "
        f"use {share}; the chopper burns the rest."
    )


def _section(title: str, told: str, *content: str) -> str:
    return f"<section><h2>{escape(title)}</h2><p class=quiet>{escape(told)}</p>{''.join(content)}</section>"


def _legend(kinds: dict[str, str]) -> str:
    return "<p class=legend>" + "".join(f'<i class="{k}"></i>{escape(v)}' for k, v in kinds.items()) + "</p>"


def _bars(found: Findings, unit: str) -> str:
    bars = []
    for run in found.runs:
        scale = 1 / run.seconds if unit == "W" else 100 / run.total
        left = run.electrical_losses_with_regeneration if run.electrical_losses is None else run.electrical_losses
        sizes = (run.electronics, run.brakes, run.mechanical_losses, left, run.regeneration or 0.0)
        parts = dict(zip(GROUPS, (scale * size for size in sizes), strict=True))
        electronics = 100 * run.electronics / run.total
        note = f"{run.total * scale:.0f} W" if unit == "W" else f"electronics {electronics:.0f} %"
        bars.append(Bar(_name(run), parts, note))
    return stacked(bars, unit, "energy by consumer")


def _curves(outcome: Outcome) -> list[str]:
    """Power over time of the paper's fastest speed and the fastest of all, each payload."""
    runs = outcome.findings.runs
    slow = max((run.speed_mm_s for run in runs if run.speed_mm_s <= PAPER_FASTEST), default=None)
    speeds = {slow, max(run.speed_mm_s for run in runs)}
    chosen = [i for i, run in enumerate(runs) if run.speed_mm_s in speeds]
    return [f"<h3>{escape(_name(runs[i]))}</h3>{_curve(outcome, i)}" for i in chosen]


def _name(run: RunEnergy) -> str:
    return f"{run.speed_mm_s:g} mm/s, {run.payload_kg:g} kg"


def _curve(outcome: Outcome, index: int) -> str:
    one, drive = outcome.identified.observed[index], outcome.identified.drive
    first = outcome.repetitions[index][0]
    motion, reading = one.run.motion, one.run.reading
    inside = (motion.time >= first.start) & (motion.time <= first.end)
    time = motion.time[inside] - first.start
    feature = one.feature[inside]
    n = len(drive.torque)
    supply = supply_power(drive, bus_power(drive, feature))
    mechanical = feature[:, :n] @ drive.torque
    fixed = outcome.findings.fixed
    level = fixed.electronics + fixed.brakes
    since = np.array([repetition.start for repetition in outcome.repetitions[index]])
    measured = (reading.time - one.offset.seconds)[None, :] - since[:, None]
    seen = (measured >= 0) & (measured <= time[-1])
    power = np.broadcast_to(reading.power, measured.shape)
    ends = np.array([0.0, time[-1]])
    lines = [
        Line("electronics", ends, np.full(2, fixed.electronics)),
        Line("brakes", ends, np.full(2, level)),
        Line("mechanical", time, mechanical),
        Line("electrical", time, supply - mechanical - level),
        Line("measured", time, supply),
        Line("measured", measured[seen], power[seen], dots=True),
    ]
    return over_time(lines, f"power over time, {one.run.name}")


def _notes(found: Findings) -> str:
    said: Sequence[str] = [
        *found.fixed.notes,
        *found.notes,
        *(f"{run.run}: {note}" for run in found.runs for note in run.notes),
    ]
    if not said:
        return ""
    items = "".join(f"<li>{escape(note)}</li>" for note in said)
    return f"<section><h2>Notes</h2><ul>{items}</ul></section>"
