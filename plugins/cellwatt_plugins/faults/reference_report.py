"""The page of ``reference``: the band of each channel over the repetitions and intervals of every task."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.report import Axis, Block, Figure, Folded, Notes, Panel, Provenance, Report, Section, Table
from cellwatt.report.drawing import curve, note, ribbon, stretch
from cellwatt.report.figure import Json
from cellwatt.report.numbers import number
from cellwatt.report.theme import MEASURED, NOISE, SERIES
from cellwatt_plugins.faults.cycles.stored import StoredCycle, StoredModel
from cellwatt_plugins.faults.reference import Pattern, Reference, ReferenceInterval, TaskReference, Variant

SPREADS = 2.0
"""Standard deviations over the cycles that a band holds to each side."""
HEIGHTS = (190, 150)
BANDS = (
    "Mean over the cycles and ± 2 standard deviations; intervals after each other, labelled with the joints that move."
)
CYCLES = "Healthy power of a whole cycle with its spread, and the path; intervals numbered."


def report(reference: Reference, left_out: int, note: str | None, provenance: Provenance) -> Report:
    """The page of a reference; ``left_out`` cycles were seen too rarely at their speed."""
    variants = [(task, variant) for task in reference.tasks for variant in task.variants]
    repeats = sum(variant.cycles for _, variant in variants) or sum(cycle.cycles for cycle in reference.cycles)
    tasks = len(reference.tasks) or len({cycle.task for cycle in reference.cycles})
    seldom = f"{left_out} cycles left out: seen too rarely at their speed." if left_out else ""
    return Report(
        name=reference.robot or reference.arm,
        subject="healthy reference",
        facts=["healthy reference", f"{reference.joints} joints", f"power: {reference.power}"],
        verdict=f"Healthy running: {tasks} task{'s' * (tasks != 1)}, learnt from {repeats} cycles.",
        tone="good",
        sections=[
            Section("Bands of the intervals", _folded([_variant(*each) for each in variants]), BANDS),
            Section("Whole cycles", _folded([_whole(cycle) for cycle in reference.cycles]), CYCLES),
            Section("Tasks", [_tasks(variants)] if variants else []),
            Section("Cycles learnt", [_cycles(reference.cycles)] if reference.cycles else []),
            Section("The arm as its power shows it", _arm(reference.power_model)),
            Section("Notes", [Notes([text for text in (seldom, note or "") if text])]),
        ],
        provenance=provenance,
    )


def _folded(figures: Sequence[tuple[str, Figure]]) -> list[Block]:
    """Each under its title, the first open."""
    return [Folded(title, [figure], i == 0) for i, (title, figure) in enumerate(figures)]


def _variant(task: TaskReference, variant: Variant) -> tuple[str, Figure]:
    """Power and position of all intervals of a task at one speed, set after each other."""
    power, position, marks = [], [], []
    begin = 0.0
    for interval in variant.intervals:
        begin += interval.rest
        power += _band("power", interval.power, MEASURED, begin)
        for joint in interval.moving:
            position += _band(f"joint {joint}", interval.position[joint], SERIES[(joint - 1) % len(SERIES)], begin)
        marks += _shade(begin, begin + interval.duration, _moving(interval))
        begin += interval.duration
    title = f"{task.name} at speed {variant.speed:.2f}, {variant.cycles} cycles"
    return title, _figure(title, power, position, marks)


def _moving(interval: ReferenceInterval) -> str:
    return "+".join(map(str, interval.moving))


def _band(name: str, pattern: Pattern, colour: str, begin: float) -> list[Json]:
    mean, spread = pattern.values, SPREADS * np.asarray(pattern.spread)
    start, step = begin + pattern.start, pattern.step
    edges = ribbon(mean - spread, mean + spread, colour, start=start, step=step)
    return [*edges, curve(name, mean, colour, start=start, step=step)]


def _whole(cycle: StoredCycle) -> tuple[str, Figure]:
    mean, spread = np.asarray(cycle.power), SPREADS * np.asarray(cycle.spread)
    power = [*ribbon(mean - spread, mean + spread, MEASURED, step=cycle.step)]
    power.append(curve("power", mean, MEASURED, step=cycle.step))
    paths = [
        curve(f"joint {joint}", path, SERIES[(joint - 1) % len(SERIES)], step=cycle.step)
        for joint, path in cycle.position.items()
    ]
    marks = [mark for i, (a, b) in enumerate(cycle.moves, start=1) for mark in _shade(a, b, str(i))]
    title = f"{cycle.task} at speed {cycle.speed:.2f}, {cycle.cycles} cycles"
    return title, _figure(title, power, paths, marks)


def _shade(start: float, end: float, text: str) -> list[Json]:
    return [stretch(start, end, NOISE), note(text, (start + end) / 2, 0.92)]


def _figure(title: str, power: Sequence[Json], position: Sequence[Json], marks: Sequence[Json]) -> Figure:
    plain = [mark for mark in marks if "text" not in mark]
    rows = [[Panel(power, Axis("s"), Axis("power, W"), marks)], [Panel(position, Axis("s"), Axis("rad"), plain)]]
    return Figure(f"Bands of power and positions of {title}", rows, HEIGHTS, "x")


def _tasks(variants: Sequence[tuple[TaskReference, Variant]]) -> Table:
    rows = [
        [task.name, f"{variant.speed:.3f}", str(variant.cycles), str(len(variant.intervals)), task.signature]
        for task, variant in variants
    ]
    return Table("Tasks", ("task", "speed", "cycles", "intervals", "joints and degrees of its intervals"), rows)


def _cycles(cycles: Sequence[StoredCycle]) -> Table:
    rows = [
        [cycle.task, f"{cycle.speed:.3f}", str(cycle.cycles), str(len(cycle.moves)), f"{max(cycle.spread):.1f}"]
        for cycle in cycles
    ]
    return Table("Cycles learnt", ("task", "speed", "cycles", "intervals", "largest spread, W"), rows)


def _arm(model: StoredModel | None) -> list[Block]:
    if model is None:
        return []
    heads = (
        "joint",
        "rotor inertia, kg m²",
        "Coulomb friction, Nm",
        "viscous friction, Nm s/rad",
        "copper loss, W/(Nm)²",
    )
    rows = [
        [j.name, *map(number, (j.rotor_inertia, j.coulomb_friction, j.viscous_friction, j.copper_loss))]
        for j in model.joints
    ]
    supply = f"Supply: {model.standby:.1f} W standing by; {model.drive:.3f} W drawn for 1 W taken"
    return [Table("Joints", heads, rows), f"{supply}, {model.regenerate:.3f} W saved for 1 W given back."]
