"""Figures over all cases, each share with its 95 % Wilson interval."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

Row = dict[str, Any]


def wilson(hits: int, of: int) -> list[float] | None:
    """95 % interval of a share (Wilson 1927); None of nothing."""
    if of == 0:
        return None
    z, p = 1.959964, hits / of
    middle, half = p + z * z / (2 * of), z * np.sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    ends = ((middle + s * half) / (1 + z * z / of) for s in (-1, 1))
    return [round(float(np.clip(end, 0.0, 1.0)), 3) for end in ends]


def share(hits: int, of: int) -> Row:
    """A share with its interval and its counts."""
    return {"value": round(hits / of, 3) if of else None, "interval": wilson(hits, of), "hits": hits, "of": of}


def median(values: Iterable[float | None]) -> float | None:
    """Median of what is there."""
    some = [v for v in values if v is not None]
    return round(float(np.median(some)), 3) if some else None


def names(scores: list[Row]) -> Row:
    """Micro precision, recall and F1 over (effect, joint) pairs; no F1 where nothing was to be found."""
    hit, false, missed = (sum(s[k] for s in scores) for k in ("hit", "false", "missed"))
    return {
        "f1": round(2 * hit / (2 * hit + false + missed), 3) if hit + missed else None,
        "precision": share(hit, hit + false),
        "recall": share(hit, hit + missed),
    }


def totals(rows: list[Row]) -> Row:
    """All figures of some cases, each with its fields and scores."""
    return {
        **summary(rows),
        "by_simulation": {
            which: summary([r for r in rows if (r["simulation"]["kind"] == "law") == (which == "law")])
            for which in ("law", "own")
        },
        "by_kind": grouped(rows, lambda r: [r["simulation"]["kind"]], summary),
        "by_level": grouped(rows, lambda r: [r["level"]]),
        "by_strength": grouped([r for r in rows if r["strength"]], lambda r: [r["strength"]]),
        "by_robot": grouped(rows, lambda r: [r["robot"]]),
        "by_effect": by_effect(rows),
    }


def summary(rows: list[Row]) -> Row:
    """The figures over some cases."""
    nulls = [r for r in rows if r["level"] == "null"]
    unknown = [r for r in rows if r["level"] == "unknown"]
    gaps = [g for r in rows for g in r["hold_out"]]
    recorded = [g for r in rows for g in r["hold_out_recorded"]]
    parameters = [p for r in rows for p in r["parameters"]]
    judged = [p["covered"] for p in parameters if p["covered"] is not None]
    return {
        "cases": len(rows),
        **names(rows),
        "exact": share(sum(s["exact"] for s in rows), len(rows)),
        "null_false_rate": share(sum(s["false"] > 0 for s in nulls), len(nulls)),
        "unknown_recall": share(sum(s["missed"] == 0 for s in unknown), len(unknown)),
        "interval_coverage": share(sum(judged), len(judged)),
        "parameter_error_median": median(p["error"] for p in parameters),
        "localisation": share(sum(s["joints_found"] for s in rows), sum(s["joints"] for s in rows)),
        "gap_closed_median": median(g["gap_closed"] for g in gaps),
        "gap_closed_recorded_median": median(g["gap_closed"] for g in recorded),
        "channels": len(gaps),
        "channels_made_worse": worse(gaps),
        "channels_made_worse_recorded": worse(recorded) if recorded else None,
        "channels_without_prediction": sum(g["model"] is None for g in gaps),
        "errors": sum(bool(s.get("error")) for s in rows),
        "seconds_median": median(s.get("seconds") for s in rows),
        "seconds_max": max((s.get("seconds") or 0.0 for s in rows), default=0.0),
    }


def worse(gaps: list[Row]) -> int:
    """Channels whose error the model raises above the simulation's."""
    return sum(g["gap_closed"] is not None and g["gap_closed"] < 0 for g in gaps)


def found(rows: list[Row]) -> Row:
    """Names and exact share alone."""
    return {**names(rows), "exact": share(sum(r["exact"] for r in rows), len(rows))}


def grouped(rows: list[Row], of: Callable[[Row], list[str]], figures: Callable[[list[Row]], Row] = found) -> Row:
    """Figures within each group of cases."""
    groups: dict[str, list[Row]] = defaultdict(list)
    for r in rows:
        for g in of(r):
            groups[g].append(r)
    return {g: figures(some) for g, some in sorted(groups.items())}


def by_effect(rows: list[Row]) -> Row:
    """How often each effect was there, was named, and was named where it was not."""
    there, hit, wrong = Counter[str](), Counter[str](), Counter[str]()
    gaps: dict[str, list[float | None]] = defaultdict(list)
    errors: dict[str, list[float]] = defaultdict(list)
    for s in rows:
        for pair in s["truth"]:
            there[pair.split("@")[0]] += 1
            hit[pair.split("@")[0]] += pair in s["named"]
        for pair in set(s["named"]) - set(s["truth"]):
            wrong[pair.split("@")[0]] += 1
        for p in s["parameters"]:
            errors[p["effect"]] += [p["error"]] if p["error"] is not None else []
        if len(s["truth"]) == 1:
            gaps[s["truth"][0].split("@")[0]] += [g["gap_closed"] for g in s["hold_out"]]
    every = sorted({*there, *wrong})
    return {
        e: {
            "recall": share(hit[e], there[e]),
            "named_wrongly": wrong[e],
            "parameter_error_median": median(errors[e]),
            "gap_closed_median": median(gaps[e]),
        }
        for e in every
    }
