"""The figures of the stories as tables for ``docs/proof-real.md``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Figures = Mapping[str, Any]


def markdown(result: Mapping[str, Figures]) -> str:
    """All tables, each story under its name."""
    return "\n\n".join(f"## {name}\n\n{_story(figures)}" for name, figures in result.items())


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """One markdown table."""
    lines = [" | ".join(cells) for cells in (head, ["---"] * len(head), *rows)]
    return "\n".join(f"| {line} |" for line in lines)


def masses(figures: Figures) -> str:
    """What each explanation says of the payload, beside the plain fits."""
    true = figures["true_mass"]
    rows = [
        [f"plain fit, {name} gains", f"{mass:.3f}", "–", f"{100 * (mass / true - 1):+.1f} %"]
        for name, mass in figures["plain_fit"].items()
    ]
    for key, told in figures.items():
        if "/" in key:
            found = told["payload"]
            interval = "–" if found is None else "{:.2f} – {:.2f}".format(*found["interval"])
            mass = "none named" if found is None else f"{found['mass']:.3f}"
            error = "–" if found is None else f"{found['error_percent']:+.1f} %"
            rows.append([f"explain, {key.replace('/', ' gains, ')}", mass, interval, error])
    return table(["", "mass, kg", "95 % interval, kg", "off"], rows)


def findings(told: Figures) -> str:
    """What was named, strongest first, with the held-out error without and with it."""
    rows = [
        [f["statement"], f["kind"], f["improvement"]["channel"], _arrow(f["improvement"]), ", ".join(f["alternatives"])]
        for f in told["findings"]
    ]
    rows += [[said, "unexplained", "", "", ""] for said in told["unexplained"]]
    return table(["finding", "kind", "channel", "held-out error, Nm", "fits as well"], rows)


def fit(told: Figures) -> str:
    """Held-out error of every joint: as simulated, retuned, with the model; and the noise floor."""
    rows = [
        [f["channel"], *(f"{f[key]:.3g}" for key in ("simulation", "refit", "model", "noise_floor")), f"{ratio:.2f}"]
        for f, ratio in zip(told["fit"], told["model_over_floor"], strict=True)
    ]
    return table(["channel", "simulation", "retuned", "model", "noise floor", "model ÷ floor"], rows)


def _story(figures: Figures) -> str:
    if "skipped" in figures or "failed" in figures:
        return str(figures.get("skipped", figures.get("failed")))
    parts = [
        f"{key}: {value}" for key, value in figures.items() if not isinstance(value, Mapping) and _is_number(value)
    ]
    parts += [masses(figures)] if "plain_fit" in figures else []
    told = (
        {"": figures}
        if "fit" in figures
        else {k: v for k, v in figures.items() if isinstance(v, Mapping) and "fit" in v}
    )
    parts += [f"**{name or 'explain'}**: {v['verdict']}\n\n{findings(v)}\n\n{fit(v)}" for name, v in told.items()]
    return "\n\n".join(parts)


def _is_number(value: Any) -> bool:
    values = value if isinstance(value, list) else [value]
    return all(isinstance(v, int | float) for v in values)


def _arrow(improvement: Mapping[str, Any]) -> str:
    return f"{improvement['before']:.3g} → {improvement['after']:.3g}"
