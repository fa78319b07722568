"""Figures over all cases, each share with its 95 % Wilson interval."""

from __future__ import annotations

from collections import defaultdict
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


def totals(rows: list[Row], method: str) -> Row:
    """All figures of one method; `rows` have the case's fields and one score a method."""
    return {
        **summary(rows, method),
        "by_simulation": {
            which: summary([r for r in rows if (r["simulation"]["kind"] == "law") == (which == "law")], method)
            for which in ("law", "own")
        },
        "by_kind": grouped(rows, method, lambda r: [r["simulation"]["kind"]], summary),
        "by_level": grouped(rows, method, lambda r: [r["level"]]),
        "by_strength": grouped([r for r in rows if r["strength"]], method, lambda r: [r["strength"]]),
        "by_robot": grouped(rows, method, lambda r: [r["robot"]]),
        "by_effect": by_effect(rows, method),
    }


def summary(rows: list[Row], method: str) -> Row:
    """The figures of one method over some cases."""
    scores = [r[method] for r in rows]
    nulls = [s for r, s in zip(rows, scores, strict=True) if r["level"] == "null"]
    unknown = [s for r, s in zip(rows, scores, strict=True) if r["level"] == "unknown"]
    gaps = [g for s in scores for g in s["hold_out"]]
    recorded = [g for s in scores for g in s.get("hold_out_recorded", [])]
    parameters = [p for s in scores for p in s["parameters"]]
    judged = [p["covered"] for p in parameters if p["covered"] is not None]
    return {
        "cases": len(rows),
        **names(scores),
        "exact": share(sum(s["exact"] for s in scores), len(scores)),
        "null_false_rate": share(sum(s["false"] > 0 for s in nulls), len(nulls)),
        "unknown_recall": share(sum(s["missed"] == 0 for s in unknown), len(unknown)),
        "interval_coverage": share(sum(judged), len(judged)),
        "parameter_error_median": median(p["error"] for p in parameters),
        "localisation": share(sum(s["joints_found"] for s in scores), sum(s["joints"] for s in scores)),
        "gap_closed_median": median(g["gap_closed"] for g in gaps),
        "gap_closed_recorded_median": median(g["gap_closed"] for g in recorded),
        "gap_closed_by_refit_median": median(g["gap_closed_refit"] for g in gaps),
        "gap_beyond_refit_median": median(g["gap_beyond_refit"] for g in gaps),
        "channels": len(gaps),
        "channels_made_worse": worse(gaps),
        "channels_made_worse_recorded": worse(recorded) if recorded else None,
        "channels_without_prediction": sum(g["model"] is None for g in gaps),
        "cases_predicted_without_simulation": sum(s.get("without_simulation", False) for s in scores),
        "channels_better_than_refit": better(gaps),
        "errors": sum(bool(s.get("error")) for s in scores),
        "seconds_median": median(s.get("seconds") for s in scores),
        "seconds_max": max((s.get("seconds") or 0.0 for s in scores), default=0.0),
    }


def better(gaps: list[Row]) -> Row:
    """Channels whose error the model brings below that of a refit, of those that were refitted."""
    refitted = [g for g in gaps if g["refit"] is not None]
    return share(sum(g["model"] is not None and g["model"] < g["refit"] for g in refitted), len(refitted))


def worse(gaps: list[Row]) -> int:
    """Channels whose error the model raises above the simulation's."""
    return sum(g["gap_closed"] is not None and g["gap_closed"] < 0 for g in gaps)


def found(rows: list[Row], method: str) -> Row:
    """Names and exact share alone."""
    scores = [r[method] for r in rows]
    return {**names(scores), "exact": share(sum(s["exact"] for s in scores), len(scores))}


def grouped(
    rows: list[Row], method: str, of: Callable[[Row], list[str]], figures: Callable[[list[Row], str], Row] = found
) -> Row:
    """Figures within each group of cases."""
    groups: dict[str, list[Row]] = defaultdict(list)
    for r in rows:
        for g in of(r):
            groups[g].append(r)
    return {g: figures(some, method) for g, some in sorted(groups.items())}


def by_effect(rows: list[Row], method: str) -> Row:
    """How often each effect was there, was named, and was named where it was not."""
    there: dict[str, int] = defaultdict(int)
    hit: dict[str, int] = defaultdict(int)
    wrong: dict[str, int] = defaultdict(int)
    gaps: dict[str, list[float | None]] = defaultdict(list)
    errors: dict[str, list[float]] = defaultdict(list)
    for r in rows:
        s = r[method]
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
