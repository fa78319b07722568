"""HTML report of ``faults``: suspected joints, intervals and residuals of every cycle, each fault and alternatives."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np

from cellwatt.report import Axis, Block, Figure, Folded, Panel, Provenance, Report, Section, Table, Tile
from cellwatt.report.drawing import cells, colours, dots, line, note, stretch
from cellwatt.report.figure import Json
from cellwatt.report.numbers import fixed
from cellwatt.report.theme import BAD, FOUND, MEASURED, MODEL, NOISE, SIMULATION
from cellwatt_plugins.faults.cycles.findings import CycleFinding, Evidence

STATES: Final = {"healthy": "good", "changed": "simulation", "new_task": "refit", "fault": "bad"}
"""Colour role of each status."""
KINDS: Final = {"joint": SIMULATION, "encoder": MODEL, "joint_and_encoder": BAD}
ROW = 24
"""Height of the row of a joint or an interval, pixels."""
SIGMAS = 2.0
"""Limits of healthy power, standard deviations."""
MOST_SHOWN, OPEN = 24, 3
"""Most faulty cycles shown, those with the largest power first, and the number of them unfolded at first."""
HIGHEST = 5.0
"""Top of the colour scale, log2 of the residual in limits."""
SUSPECTS = (
    "Marks are joints reported as faulty, larger for more power; rings are joints that explain it nearly as well. "
    "Below: the largest difference of power in each interval, in limits (± 2 standard deviations of healthy cycles); "
    "dots mark intervals in which a fault shows. Harmless changes, as of a part's weight, also change power, without a "
    "mark."
)
EXPLAINED = (
    "Power minus that of healthy cycles. Shaded: intervals of the task; yellow: intervals in which a fault shows."
)


def report(cycles: Sequence[CycleFinding], evidence: Sequence[Evidence], joints: int, provenance: Provenance) -> Report:
    """The report of all cycles in order; ``evidence`` of the cycles judged by physics."""
    count: Counter[str] = Counter(cycle.status for cycle in cycles)
    faulty = [n for n, cycle in enumerate(cycles, start=1) if cycle.faults]
    suspects = [_suspects(cycles, evidence, joints)] if cycles else []
    return Report(
        name="Cycles",
        subject="faults",
        facts=[f"{len(cycles)} cycles", f"{cycles[-1].end - cycles[0].start:.0f} s" if cycles else "0 s"],
        verdict=_verdict(cycles),
        tone="open" if faulty else "good",
        tiles=[Tile(status.replace("_", " "), str(count[status]), "", role) for status, role in STATES.items()],
        tiles_remark="Cycles by status.",
        sections=[
            Section("Suspected joints and intervals", suspects, SUSPECTS),
            Section("Faults", _faulty_cycles(cycles, evidence, faulty), EXPLAINED),
            Section("All cycles", [_cycles(cycles)] if cycles else []),
        ],
        provenance=provenance,
    )


def _verdict(cycles: Sequence[CycleFinding]) -> str:
    faulty = [cycle for cycle in cycles if cycle.faults]
    if not faulty:
        return f"None of {len(cycles)} cycles shows a fault."
    named = Counter(joint for cycle in faulty for joint in {fault.joint for fault in cycle.faults} if joint)
    text = f"{len(faulty)} of {len(cycles)} cycles show{'s' * (len(faulty) == 1)} a fault"
    if not named:
        return f"{text}; no joint can be named."
    joint, times = named.most_common(1)[0]
    return f"{text}; joint {joint} is named most often, in {times} of them."


def _suspects(cycles: Sequence[CycleFinding], evidence: Sequence[Evidence], joints: int) -> Figure:
    """Plot the named joints and the largest power difference in each interval over the cycles."""
    numbers = {id(cycle): n for n, cycle in enumerate(cycles, start=1)}
    x = Axis("cycle", (0.3, len(cycles) + 0.7), grid=False)
    ticks = {float(j): f"joint {j}" for j in range(1, joints + 1)}
    rows = [[Panel(_named(cycles), x, Axis(ticks=ticks, span=(joints + 0.6, 0.4)))]]
    heights = [ROW * joints]
    most = max((len(each.moves) for each in evidence), default=0)
    if most:
        shades = _intervals(evidence, [numbers[id(e.finding)] for e in evidence], len(cycles), most)
        rows.append([Panel(shades, x, Axis(names=True, grid=False))])
        heights.append(ROW * most)
    powers = range(int(HIGHEST) + 1)
    layout = colours(HIGHEST, "÷ limit", powers, [f"{2**power}×" for power in powers]) if most else {}
    return Figure("Suspected joints and intervals of every cycle", rows, heights, "x", sides=(70, 80), layout=layout)


def _named(cycles: Sequence[CycleFinding]) -> list[Json]:
    """Marks of the faulty joints by kind of fault, and rings for the alternatives."""
    out = []
    for kind, colour in KINDS.items():
        mine = [(n, f) for n, c in enumerate(cycles, start=1) for f in c.faults if f.kind == kind and f.joint]
        sizes = [float(np.clip(6 + 2 * np.sqrt(f.size_watt), 8, 22)) for _, f in mine]
        hovers = [f"cycle {n}: {f.statement}" for n, f in mine]
        name = kind.replace("_", " ")
        out.append(
            dots(name, [n for n, _ in mine], [f.joint for _, f in mine], colour, size=sizes, opacity=0.75, hover=hovers)
        )
    others = [(n, j) for n, c in enumerate(cycles, start=1) for f in c.faults for j in f.alternatives]
    rings = dots(
        "alternative", [n for n, _ in others], [j for _, j in others], MEASURED, size=9, opacity=1, symbol="circle-open"
    )
    return [*out, rings]


def _intervals(evidence: Sequence[Evidence], numbers: Sequence[int], count: int, most: int) -> list[Json]:
    """Largest power difference of each interval in limits, and marks of the intervals in which a fault shows."""
    ratio = np.full((most, count), np.nan)
    for each, number in zip(evidence, numbers, strict=True):
        limits = np.abs(each.residual) / (SIGMAS * each.sigma)
        for row, (start, end) in enumerate(each.moves):
            ratio[row, number - 1] = limits[(each.tau >= start) & (each.tau <= end)].max(initial=0.0)
    with np.errstate(divide="ignore"):
        shade = np.maximum(np.log2(ratio), 0.0)
    names = [f"interval {row + 1}" for row in range(most)]
    hovers = [[f"cycle {n + 1}\n{value:.1f} × limit" for n, value in enumerate(row)] for row in ratio]
    shown = [
        (n, names[m - 1]) for e, n in zip(evidence, numbers, strict=True) for f in e.finding.faults for m in f.intervals
    ]
    mark = dots("", [n for n, _ in shown], [1.0] * len(shown), MODEL, size=5, opacity=1)
    return [cells(np.arange(1, count + 1), names, shade, hovers), mark | {"y": [name for _, name in shown]}]


def _faulty_cycles(cycles: Sequence[CycleFinding], evidence: Sequence[Evidence], faulty: Sequence[int]) -> list[Block]:
    """The faulty cycles, largest power first, each with the statements on its faults and the residual."""
    known = {id(each.finding): each for each in evidence}
    order = sorted(faulty, key=lambda n: -max(fault.size_watt for fault in cycles[n - 1].faults))[:MOST_SHOWN]
    out: list[Block] = []
    if len(faulty) > MOST_SHOWN:
        out.append(f"The {MOST_SHOWN} of {len(faulty)} faulty cycles with the largest power are shown.")
    for rank, number in enumerate(order):
        cycle = cycles[number - 1]
        shown = known.get(id(cycle))
        blocks: list[Block] = [fault.statement for fault in cycle.faults]
        blocks += [_residual(shown, number)] if shown is not None else []
        named = ", ".join(f"joint {f.joint}" if f.joint else "a joint" for f in cycle.faults)
        out.append(Folded(f"Cycle {number}, {cycle.task} at {cycle.start:.1f} s: {named}", blocks, rank < OPEN))
    return out


def _residual(each: Evidence, number: int) -> Figure:
    """Plot the difference from healthy power, its limits, and the power explained by the named faults."""
    limit = SIGMAS * each.sigma
    traces = [
        line("limits", each.tau, limit, NOISE, dash="dot", width=1.2),
        line("limits", each.tau, -limit, NOISE, dash="dot", width=1.2),
        line("measured − healthy", each.tau, each.residual, SIMULATION),
        line("explained by the faults named", each.tau, each.explained, MODEL, width=2.2),
    ]
    named = {move for fault in each.finding.faults for move in fault.intervals}
    marks: list[Json] = []
    for move, (start, end) in enumerate(each.moves, start=1):
        marks.append(stretch(start, end, FOUND if move in named else NOISE, 0.2 if move in named else 0.12))
        marks.append(note(str(move), (start + end) / 2, 0.92))
    panel = Panel(traces, Axis("s of the healthy cycle"), Axis("W"), marks)
    return Figure(f"Power of cycle {number} less that of healthy cycles, with its limits", [[panel]], (190,))


def _cycles(cycles: Sequence[CycleFinding]) -> Table:
    heads = ("cycle", "start, s", "end, s", "task", "speed", "status", "what is known", "confidence", "alternatives")
    rows = []
    for n, cycle in enumerate(cycles, start=1):
        head = [str(n), fixed(cycle.start, 2), fixed(cycle.end, 2), cycle.task, fixed(cycle.speed, 3)]
        head.append(cycle.status.replace("_", " "))
        for fault in cycle.faults:
            others = ", ".join(map(str, fault.alternatives)) or "–"
            known = " ".join(filter(None, (fault.statement, cycle.note)))
            rows.append([*head, known, fixed(fault.confidence, 4), others])
        if not cycle.faults:
            rows.append([*head, cycle.note, "", ""])
    return Table("All cycles", heads, rows)
