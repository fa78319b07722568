"""The figures as tables for the proof's page."""

from __future__ import annotations

from typing import Any

from concealed.own import OWN

Row = dict[str, Any]
LINES = (
    ("F1 over (effect, joint)", "f1"),
    ("precision", "precision"),
    ("recall", "recall"),
    ("exact set", "exact"),
    ("false alarms on nulls", "null_false_rate"),
    ("unknown called unknown", "unknown_recall"),
    ("right joint among those named", "localisation"),
    ("95 % intervals that hold the truth", "interval_coverage"),
    ("parameter error, median", "parameter_error_median"),
    ("gap to the best possible closed on sealed runs, median", "gap_closed_median"),
    ("the same on the motion as it was recorded", "gap_closed_recorded_median"),
    ("channels made worse than the simulation", "channels_made_worse"),
    ("the same on the motion as it was recorded", "channels_made_worse_recorded"),
    ("channels", "channels"),
    ("seconds a case, median", "seconds_median"),
)


SIMULATIONS = {"law": "robot.yaml's law", "own": "own simulation"}
KIND_COLUMNS = (
    ("F1", "f1"),
    ("exact set", "exact"),
    ("nulls with false names", "null_false_rate"),
    ("unknown called unknown", "unknown_recall"),
    ("95 % intervals", "interval_coverage"),
    ("parameter error", "parameter_error_median"),
    ("gap closed", "gap_closed_median"),
    ("channels made worse", "channels_made_worse"),
)


def cell(x: Any) -> str:
    """A figure as text; a share with its interval and counts."""
    if isinstance(x, dict):
        if x["of"] == 0:
            return "–"
        low, high = x["interval"]
        return f"{x['value']:.3f} ({low:.2f}–{high:.2f}; {x['hits']}/{x['of']})"
    return "–" if x is None else f"{x:.3f}" if isinstance(x, float) else str(x)


def table(head: list[str], rows: list[list[str]]) -> str:
    """One markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(r) + " |" for r in rows])


def by_simulation(first: Row) -> list[str]:
    """All cases, those of robot.yaml's law and those of simulations of the user's own; then by kind."""
    columns = {"all": first, **{title: first["by_simulation"][k] for k, title in SIMULATIONS.items()}}
    whole = [["cases", *(cell(t["cases"]) for t in columns.values())]]
    whole += [[name, *(cell(t.get(key)) for t in columns.values())] for name, key in LINES]
    titles = {"law": SIMULATIONS["law"], **{k: f"({letter}) {OWN[k]}" for letter, k in zip("abcdef", OWN, strict=True)}}
    kinds = [(title, first["by_kind"][k]) for k, title in titles.items() if k in first["by_kind"]]
    return [
        table(["", *columns], whole),
        table(
            ["simulation", "cases", *(title for title, _ in KIND_COLUMNS)],
            [[title, cell(x["cases"]), *(cell(x[key]) for _, key in KIND_COLUMNS)] for title, x in kinds],
        ),
    ]


def markdown(result: Row) -> str:
    """Figures by simulation, level, strength and effect, then the failures."""
    first = result["totals"]
    groups = [
        table([title, "F1", "exact set"], [[g, cell(x["f1"]), cell(x["exact"])] for g, x in first[key].items()])
        for title, key in (("level", "by_level"), ("strength", "by_strength"), ("robot", "by_robot"))
    ]
    effects = table(
        ["effect", "found", "named where it is not", "parameter error, median", "gap closed, median"],
        [
            [
                e,
                cell(x["recall"]),
                cell(x["named_wrongly"]),
                cell(x["parameter_error_median"]),
                cell(x["gap_closed_median"]),
            ]
            for e, x in first["by_effect"].items()
        ],
    )
    failures = table(
        ["case", "robot", "simulation", "level", "size / noise", "truth", "named"],
        [
            [
                f["id"],
                f["robot"],
                f["simulation"],
                f["level"],
                cell(f["ratio"]),
                ", ".join(f["truth"]) or "–",
                f["error"] or ", ".join(f["named"]) or "–",
            ]
            for f in result["failures"]
        ],
    )
    text = f"{result['cases']} cases, {result['nulls']} of them nulls."
    return "\n\n".join([text, *by_simulation(first), *groups, effects, failures])
