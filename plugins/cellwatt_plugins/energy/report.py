"""HTML report of ``disaggregate``: Tables II and III and Figs 6 to 8 of ECDP."""

from __future__ import annotations

from typing import Final

import numpy as np

from cellwatt.report import Axis, Block, Figure, Html, Notes, Panel, Provenance, Report, Section, Table, heading
from cellwatt.report.drawing import bars, curve, dots, line, note
from cellwatt.report.theme import BAD, CURVE, GOOD, MEASURED, MODEL, PALE, SIMULATION
from cellwatt.units import Unit, Units
from cellwatt_plugins.energy.drive import bus_power, supply_power
from cellwatt_plugins.energy.findings import Findings, Fixed, RunEnergy
from cellwatt_plugins.energy.identify import Identified
from cellwatt_plugins.energy.wording import amount, unsure

GROUPS: Final = {
    "electronics": MODEL,
    "brakes": PALE,
    "mechanical losses": GOOD,
    "electrical losses": SIMULATION,
    "chopper": BAD,
}
OVER_TIME = (
    "The first repetition, and measured values of all. Each is a mean over the analyzer's interval: where power "
    "changes faster, dots lie inside the peaks."
)
PAPER_FASTEST = 250.0
"""Fastest speed of the paper, mm/s, plotted over time together with the fastest of the campaign."""
_PERCENT: Final = Unit("%")
ROW = 22
"""Height of a bar, pixels."""


def report(found: Findings, identified: Identified, provenance: Provenance, units: Units) -> Report:
    """Return the report of a campaign, energies and powers in ``units``."""
    energy, power = units.of("J"), units.of("W")
    runs = found.runs
    remarks = [*found.fixed.notes, *found.notes, *(f"{run.run}: {note}" for run in runs for note in run.notes)]
    return Report(
        name=found.robot,
        subject="energy by consumer",
        facts=["energy by consumer", f"{len(runs)} runs", f"{sum(run.repetitions for run in runs)} repetitions"],
        verdict=headline(found),
        sections=[
            Section("Fixed power", [_fixed(found, power)], "Independent of the motion."),
            Section("Average power of each run", [_bars(found, power)], f"{power.name}, over one repetition."),
            Section("Over time", _curves(found, identified, power), OVER_TIME),
            Section("Energies of one repetition", [_energies(found, energy)], _columns_told(found, energy)),
            Section("Payload efficiency", _payload(found), "ε_P = 100 (E_RL − E_RNL) / E_RL."),
            Section("Notes", [Notes(remarks)]),
        ],
        provenance=provenance,
    )


def headline(found: Findings) -> str:
    """One sentence on the shares of the groups in the mean power, largest first."""
    names = {
        "electronics": "electronics take",
        "brakes": "brakes take",
        "mechanical_losses": "friction takes",
        "electrical_losses_with_regeneration": "motors and drives take",
    }
    ranked = sorted(found.average_share_percent.items(), key=lambda item: -item[1])
    words = [f"{names[group]} {share:.0f} %" for group, share in ranked]
    return f"Of the mean power of these runs {words[0]}, {words[1]}, {words[2]} and {words[3]}."


def _columns_told(found: Findings, energy: Unit) -> str:
    share = f"{100 * found.returned:.0f} ± {unsure(100 * found.returned_uncertainty, _PERCENT)} %"
    return (
        f"{energy.name} with one standard deviation, and percent of the total. L_E* = L_E + E_RB; “at most” is the "
        f"negative mechanical energy that ECDP takes for E_RB. Of the energy that motors return to the bus, the "
        f"electronics use {share}; the chopper burns the rest."
    )


def _bars(found: Findings, power: Unit) -> Figure:
    """Stacked bars of mean power, one per run, with the electronics' share (Figs 7 and 8)."""
    runs = found.runs
    labels = [_name(run) for run in runs]
    energies = np.array([[energy or 0.0 for energy in run.split] for run in runs])
    sizes = energies / np.array([[run.seconds * power.factor] for run in runs])
    traces = [bars(name, labels, sizes[:, i], colour, power.name) for i, (name, colour) in enumerate(GROUPS.items())]
    ends = np.maximum(sizes, 0.0).sum(axis=1)
    shares = [f"electronics {100 * run.electronics / run.total:.0f} %" for run in runs]
    remarks = [
        f"{amount(run.total / run.seconds, power, 0)} {power.name}, {share}"
        for run, share in zip(runs, shares, strict=True)
    ]
    marks = [
        {**note(f" {text}", float(end), i, up="y"), "xanchor": "left", "yanchor": "middle"}
        for i, (text, end) in enumerate(zip(remarks, ends, strict=True))
    ]
    x = Axis(power.name, (0.0, 1.3 * float(ends.max())))
    rows = [[Panel(traces, x, Axis(names=True, grid=False), marks)]]
    return Figure(
        "Stacked bars of each run's mean power by consumer",
        rows,
        (ROW * len(labels),),
        layout={"barmode": "stack", "bargap": 0.22},
    )


def _curves(found: Findings, identified: Identified, power: Unit) -> list[Block]:
    """Power over time at the paper's fastest speed and the fastest of all, for each payload (Fig. 6)."""
    runs = found.runs
    slow = max((run.speed_mm_s for run in runs if run.speed_mm_s <= PAPER_FASTEST), default=None)
    speeds = {slow, max(run.speed_mm_s for run in runs)}
    chosen = [i for i, run in enumerate(runs) if run.speed_mm_s in speeds]
    return [block for i in chosen for block in (heading(_name(runs[i])), _curve(found.fixed, identified, i, power))]


def _name(run: RunEnergy) -> str:
    return f"{run.speed_mm_s:g} mm/s, {run.payload_kg:g} kg"


def _curve(fixed: Fixed, identified: Identified, index: int, unit: Unit) -> Figure:
    one, drive = identified.observed[index], identified.drive
    first = one.repetitions[0]
    motion, reading = one.run.motion, one.run.reading
    inside = (motion.time >= first.start) & (motion.time <= first.end)
    time = motion.time[inside] - first.start
    feature = one.feature[inside]
    supply = supply_power(drive, bus_power(drive, feature))
    mechanical = feature[:, : len(drive.torque)] @ drive.torque
    level = fixed.electronics + fixed.brakes
    since = np.array([repetition.start for repetition in one.repetitions])
    measured = (reading.time - one.offset.seconds)[None, :] - since[:, None]
    seen = (measured >= 0) & (measured <= time[-1])
    power = np.broadcast_to(reading.power, measured.shape)
    ends, step = np.array([0.0, time[-1]]), float(np.median(np.diff(time)))
    traces = [
        line("electronics", ends, unit.of(np.full(2, fixed.electronics)), MODEL),
        line("electronics and brakes", ends, unit.of(np.full(2, level)), PALE),
        curve("mechanical power", unit.of(mechanical), GOOD, step=step),
        curve("electrical losses and chopper", unit.of(supply - mechanical - level), SIMULATION, step=step),
        curve("model of the supply", unit.of(supply), CURVE, step=step),
        dots("measured", measured[seen], unit.of(power[seen]), MEASURED, size=5, opacity=0.9),
    ]
    label = f"Power of each consumer over one repetition, {one.run.name}"
    return Figure(label, [[Panel(traces, Axis("s"), Axis(unit.name))]], (240,))


def _fixed(found: Findings, power: Unit) -> Table:
    """Table II: power that does not depend on the motion."""
    fixed = found.fixed
    cells = [
        (fixed.controller, fixed.controller_uncertainty),
        (fixed.robot_electronics, fixed.robot_electronics_uncertainty),
        (fixed.electronics, fixed.robot_electronics_uncertainty),
        (fixed.brakes, fixed.brakes_uncertainty),
    ]
    heads = ["P<sub>RC</sub> controller", "P<sub>RE</sub> robot", "P<sub>E</sub> both", "P<sub>MB</sub> brakes"]
    row = [found.robot, *(_level(value, spread, power) for value, spread in cells)]
    return Table("Fixed power", ["Robot", *map(Html, heads)], [row])


def _level(value: float, spread: float, power: Unit) -> str:
    return f"{amount(value, power, 2)} ± {unsure(spread, power)} {power.name}"


def _energies(found: Findings, energy: Unit) -> Table:
    """Table III: energies of a repetition, and their share in the total, percent."""
    named = [
        ("Run", ""),
        ("T", "time, s"),
        ("E<sub>R</sub>", "total"),
        ("E<sub>E</sub>", "electronics"),
        ("E<sub>MB</sub>", "brakes"),
        ("L<sub>M</sub>", "mechanical<br>losses"),
        ("L<sub>E</sub>*", "electrical losses<br>and chopper"),
        ("L<sub>E</sub>", "electrical<br>losses"),
        ("E<sub>RB</sub>", "chopper"),
        ("at most", "chopper"),
        ("E<sub>M+</sub>", "positive<br>mechanical"),
        ("ε<sub>M+</sub>", "%"),
    ]
    heads = [Html(f"{symbol}<br><small>{name}</small>") for symbol, name in named]
    return Table("Energies of one repetition", heads, [_row(run, energy) for run in found.runs])


def _row(run: RunEnergy, energy: Unit) -> list[str]:
    def both(name: str) -> Html:
        value, spread = getattr(run, name), run.uncertainty.get(name)
        if value is None:
            return Html("not reported")
        share = f"<small>{100 * value / run.total:.1f} %</small>"
        return Html(f"{amount(value, energy)}<small> ± {unsure(spread or 0.0, energy)}</small><br>{share}")

    names = ("electronics", "brakes", "mechanical_losses", "electrical_losses_with_regeneration")
    return [
        Html(f"{_name(run)}<br><small>{run.repetitions} repetitions</small>"),
        f"{run.seconds:.2f}",
        Html(f"{amount(run.total, energy)}<small> ± {unsure(run.uncertainty.get('total') or 0.0, energy)}</small>"),
        *(both(name) for name in (*names, "electrical_losses", "regeneration")),
        amount(run.regeneration_upper_bound, energy),
        amount(run.positive_mechanical, energy),
        f"{run.motion_efficiency_percent:.1f}",
    ]


def _payload(found: Findings) -> list[Block]:
    """ε_P (eq. 21) by speed."""
    efficiency = found.payload_efficiency_percent
    row = ["ε_P", *(f"{value:.1f} %" for value in efficiency.values())]
    return [Table("Payload efficiency", ["", *(f"{speed} mm/s" for speed in efficiency)], [row])] if efficiency else []
