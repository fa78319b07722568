"""The figures as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any


def spread_of(values: Sequence[float], digits: int = 1) -> str:
    """Median, and lowest to highest: ``61.2 (60.8 … 64.0)``."""
    return f"{median(values):.{digits}f} ({min(values):.{digits}f} … {max(values):.{digits}f})"


def markdown(result: Mapping[str, Any]) -> str:
    """All tables."""
    return "\n\n".join([_measured(result), _parts(result), _law(result)])


def _measured(result: Mapping[str, Any]) -> str:
    serial = [run["seconds"] for run in result["runs"]["serial"]]
    lines = [
        f"{result['recordings']} recordings of {result['seconds']:g} s; "
        f"findings.json and model.yaml {'are the same bytes' if result['same_bytes'] else 'DIFFER'}",
        "",
        "| way | s | s of computing, all processes | times as fast as serial | found |",
        "|---|---|---|---|---|",
    ]
    for name, runs in result["runs"].items():
        seconds = [run["seconds"] for run in runs]
        ratios = [one / other for one, other in zip(serial, seconds, strict=True)]
        found = ", ".join(runs[-1]["found"])
        computing = spread_of([run["computing"] for run in runs])
        lines.append(f"| {name} | {spread_of(seconds)} | {computing} | {spread_of(ratios, 2)} | {found} |")
    return "\n".join(lines)


def _parts(result: Mapping[str, Any]) -> str:
    stages = _together(result["inside"]["stages"])
    rest = result["inside"]["seconds"] - sum(each["seconds"] for each in stages)
    lines = ["| part | s of computing | tasks | longest task, s | MB sent |", "|---|---|---|---|---|"]
    lines += [
        f"| {each['what']} | {each['seconds']:.1f} | {each['tasks']} | {each['longest']:.3f} | "
        f"{(each['bytes'] + each['shared']) * 1e-6:.1f} |"
        for each in stages
    ]
    costs = result["overheads"]
    lines += [
        f"| all else, which is not spread | {rest:.1f} | – | – | – |",
        "",
        f"A scheduler starts in {costs['start']:.1f} s; a task costs {1e3 * costs['task']:.1f} ms, "
        f"a MB {1e9 * costs['byte']:.1f} ms. Each worker makes for itself what takes {costs['anew']:.1f} s.",
    ]
    return "\n".join(lines)


def _together(stages: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Stages of one name as one."""
    out: dict[str, dict[str, Any]] = {}
    for each in stages:
        if (so_far := out.get(each["what"])) is None:
            out[each["what"]] = dict(each)
            continue
        so_far["longest"] = max(so_far["longest"], each["longest"])
        for name in ("seconds", "tasks", "bytes", "shared"):
            so_far[name] += each[name]
    return list(out.values())


def _law(result: Mapping[str, Any]) -> str:
    law = dict(result["law"])
    serial = law.pop("serial")
    names, runs = list(law), result["runs"]
    lines = [
        "| workers | " + " | ".join(names) + " |",
        "|" + "---|" * (len(names) + 1),
        "| s by the law | " + " | ".join(f"{law[w]:.0f}" for w in names) + " |",
        "| times as fast as serial by the law | " + " | ".join(f"{serial / law[w]:.2f}" for w in names) + " |",
    ]
    measured = [
        f"{median(one['seconds'] for one in runs['serial']) / median(one['seconds'] for one in runs[f'local:{w}']):.2f}"
        if f"local:{w}" in runs
        else "–"
        for w in names
    ]
    return "\n".join([*lines, "| measured | " + " | ".join(measured) + " |"])
