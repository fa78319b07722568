"""The parts of the page that are text, bars and tables; every foreign text is escaped here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from cellwatt_plugins.mismatch.fit.solution import Trial
from cellwatt_plugins.mismatch.report import words
from cellwatt_plugins.mismatch.verdict.findings import (
    ChannelFit,
    Finding,
    Findings,
    Improvement,
    UnexplainedChannel,
    Where,
)

MOST_TRIALS = 16
"""Shown at once; the rest is folded."""
_VERDICT_CLASS = {"no_mismatch": "good", "explained": "found", "partly_explained": "part", "unexplained": "open"}


def section(title: str, lead: str, content: str) -> str:
    """A heading with its text; nothing where there is no content."""
    text = f"<p class=quiet>{escape(lead)}</p>" if lead else ""
    return f"<section><h2>{escape(title)}</h2>{text}{content}</section>" if content else ""


def banner(findings: Findings) -> str:
    """The verdict: one sentence in its colour, and how far the error came down."""
    tiles = _tiles(findings.fit)
    return (
        f'<section class="verdict {_VERDICT_CLASS[findings.verdict]}"><p class=badge>'
        f"{escape(findings.verdict.replace('_', ' '))}</p><h1>{escape(words.verdict(findings))}</h1>{tiles}</section>"
    )


def _tiles(fit: Sequence[ChannelFit]) -> str:
    parts = []
    for key, label in (("simulation", "Simulation"), ("refit", "Simulation, retuned"), ("model", "Model")):
        ratios = [(_ratio(getattr(f, key), f.noise_floor), f.channel) for f in fit]
        known = [(r, c) for r, c in ratios if math.isfinite(r)]
        if known:
            worst, channel = max(known)
            middle = float(np.median([r for r, _ in known]))
            where = words.channel_name(channel) + (f"; median of all {words.times(middle)}" if len(known) > 1 else "")
            parts.append(
                f"<div class={key}><dt>{label}</dt><dd>{words.times(worst)}</dd><small>{escape(where)}</small></div>"
            )
    caption = "<p class=quiet>Held-out error of the worst channel, in noise floors: 1× is noise.</p>"
    return f"<dl class=tiles>{''.join(parts)}</dl>{caption}" if parts else ""


def _ratio(value: float, floor: float) -> float:
    return value / floor if math.isfinite(value) and math.isfinite(floor) and floor > 0 else math.nan


def found(findings: Findings) -> str:
    """A card for each finding and for each channel that stays unexplained."""
    units = {f.channel: f.unit for f in findings.fit}
    rests = [_unexplained_card(r, units.get(r.channel, "")) for r in findings.unexplained]
    return "".join([*(_finding_card(f) for f in findings.findings), *rests])


def _finding_card(finding: Finding) -> str:
    """One finding: what, how much, how sure, where, how much better, and what else it could be."""
    unknown = finding.effect == words.UNKNOWN
    gain = _remains(finding.improvement) if unknown else _improvement(finding.improvement)
    kind = (
        "not explained" if unknown else "value is off" if finding.kind == "mistuned" else "missing from the simulation"
    )
    return (
        f'<article class="card {"open" if unknown else finding.kind}">'
        f"<header><h3>{escape(words.capital(words.named(finding)))}</h3><span class=tag>{kind}</span>"
        f"<span class=sure>{escape(words.confidence(finding.confidence))}</span></header>"
        f"<p class=statement>{escape(finding.statement)}</p>"
        f"<div class=columns><div>{_parameters(finding)}{_where(finding.where)}</div>"
        f"<div>{gain}</div></div>{_alternatives(finding)}</article>"
    )


def _unexplained_card(rest: UnexplainedChannel, symbol: str) -> str:
    """A channel that stays above its noise floor, in the unit ``symbol``."""
    name = words.capital(words.channel_name(rest.channel))
    place = Where((rest.channel,), rest.position, rest.velocity)
    bars = _bars([("remains", "model", rest.rms)], rest.noise_floor, symbol)
    ratio = words.times(_ratio(rest.rms, rest.noise_floor))
    return (
        f'<article class="card open"><header><h3>{escape(name)}</h3><span class=tag>not explained</span>'
        f"<span class=sure>{ratio} the noise</span></header><p class=statement>{escape(rest.statement)}</p>"
        f"<div class=columns><div>{_where(place)}</div><div>{bars}</div></div></article>"
    )


def _parameters(finding: Finding) -> str:
    rows = "".join(
        f"<tr><th>{escape(name.replace('_', ' '))}</th><td>{words.measured(p.value, p.std)} "
        f"<span class=unit>{escape(words.unit(p.unit))}</span></td></tr>"
        for name, p in finding.parameters.items()
    )
    return f"<table class=parameters>{rows}</table>" if rows else ""


def _where(where: Where) -> str:
    parts = [words.channel_name(c) for c in where.channels[:3]]
    more = len(where.channels) - len(parts)
    texts = [words.listed(parts) + (f" and {more} more" if more else "")] if parts else []
    texts += [f"at {words.between(where.velocity, 'rad/s')}"] if where.velocity else []
    texts += [f"at {words.degrees(where.position)}"] if where.position else []
    texts += [f"in {words.moments(where.times)}"] if where.times else []
    return f"<p class=where><b>Where</b> {escape('; '.join(texts))}</p>" if texts else ""


def _improvement(gain: Improvement) -> str:
    bars = _bars([("without", "refit", gain.before), ("with", "model", gain.after)], gain.noise_floor, gain.unit)
    data = "data the fit did not see" if gain.held_out else "the data of the fit"
    span = gain.before - gain.noise_floor
    closed = (gain.before - gain.after) / span if span > 0 else math.nan
    if gain.after > gain.before:
        outcome = "<b class=worse>Worse with it.</b> "
    else:
        outcome = f"<b>{100 * min(closed, 1):.0f} % of the gap closed.</b> " if math.isfinite(closed) else ""
    channel = escape(words.capital(words.channel_name(gain.channel)))
    return f"{bars}<p class=quiet>{outcome}{channel}, rms on {data}; both with all nominal parameters retuned.</p>"


def _remains(rest: Improvement) -> str:
    return _bars([("remains", "model", rest.after)], rest.noise_floor, rest.unit)


def _bars(rows: Sequence[tuple[str, str, float]], floor: float, symbol: str) -> str:
    """Bars with the noise floor as a mark through all of them; ``rows``: label, colour class, value."""
    known = [v for v in (*(v for _, _, v in rows), floor) if math.isfinite(v)]
    top = max([*known, 0.0]) * 1.04 or 1.0
    digits = words.decimals_for(floor if math.isfinite(floor) and floor > 0 else top)
    mark = f' style="--floor:{100 * floor / top:.1f}%"' if math.isfinite(floor) else ""
    text = escape(words.unit(symbol))
    drawn = "".join(
        f"<span>{escape(label)}</span><div class=track><i class={key} "
        f'style="width:{100 * max(value, 0) / top if math.isfinite(value) else 0:.1f}%"></i></div>'
        f"<span class=value>{words.fixed(value, digits)} {text}</span>"
        for label, key, value in rows
    )
    last = (
        f"<span>noise floor</span><div class=track></div><span class=value>{words.fixed(floor, digits)} {text}</span>"
    )
    return f"<div class=bars{mark}>{drawn}{last}</div>"


def _alternatives(finding: Finding) -> str:
    items = "".join(
        f"<li><b>{escape(words.capital(words.named(other)))}</b>: {escape(other.why)}</li>"
        for other in finding.alternatives
    )
    return f"<div class=other><b>Could also be</b><ul>{items}</ul></div>" if items else ""


def fit_table(fit: Sequence[ChannelFit]) -> str:
    """Held-out error of each channel, in figures and as dots on a scale of noise floors."""
    if not fit:
        return ""
    ratios = [_ratio(v, f.noise_floor) for f in fit for v in (f.simulation, f.refit, f.model)]
    top = max([2.0, *(r for r in ratios if math.isfinite(r))]) * 1.1
    rows = "".join(_fit_row(f, top) for f in fit)
    ticks = "".join(
        f'<span style="left:{_place(t, top):.1f}%">{t}×</span>' for t in (1, 2, 5, 10, 20, 50, 100, 200) if t <= top
    )
    heads = "".join(
        f"<th class=n><i class={k}></i>{label}</th>"
        for k, label in (
            ("simulation", "simulation"),
            ("refit", "retuned"),
            ("model", "model"),
            ("floor", "noise floor"),
        )
    )
    return (
        f'<table class=fit style="--one:{_place(1.0, top):.1f}%">'
        f"<thead><tr><th>channel</th>{heads}<th>unit</th>"
        f"<th class=scale><div>{ticks}</div></th></tr></thead><tbody>{rows}</tbody></table>"
    )


def _fit_row(fit: ChannelFit, top: float) -> str:
    digits = words.decimals_for(fit.noise_floor)
    values = (fit.simulation, fit.refit, fit.model, fit.noise_floor)
    cells = "".join(f"<td class=n>{words.fixed(v, digits)}</td>" for v in values)
    places = [_place(_ratio(v, fit.noise_floor), top) for v in values[:3]]
    dots = "".join(
        f'<i class={key} style="left:{place:.1f}%"></i>'
        for key, place in zip(("simulation", "refit", "model"), places, strict=True)
        if math.isfinite(place)
    )
    ends = [p for p in places if math.isfinite(p)]
    line = f'<u style="left:{min(ends):.1f}%;width:{max(ends) - min(ends):.1f}%"></u>' if ends else ""
    return (
        f"<tr><th>{escape(words.capital(words.channel_name(fit.channel)))}</th>{cells}"
        f"<td>{escape(words.unit(fit.unit))}</td><td class=scale><div>{line}{dots}</div></td></tr>"
    )


def _place(ratio: float, top: float) -> float:
    """Percent along a logarithmic scale from 0.7 to ``top`` noise floors."""
    if not math.isfinite(ratio):
        return math.nan
    return 100 * math.log(max(ratio, 0.7) / 0.7) / math.log(top / 0.7)


def trials(tried: Sequence[Trial]) -> str:
    """Candidates by evidence, each with the reason why it was kept or refused."""
    if not tried:
        return ""
    order = sorted(tried, key=lambda t: (-t.kept, -t.gain if math.isfinite(t.gain) else math.inf))
    top = max([1.0, *(t.gain for t in tried if math.isfinite(t.gain))])
    rows = [_trial(t, top) for t in order]
    shown, folded = rows[:MOST_TRIALS], rows[MOST_TRIALS:]
    more = f"<details><summary>{len(folded)} more</summary>{_table(folded)}</details>" if folded else ""
    return _table(shown) + more


def _table(rows: Sequence[str]) -> str:
    return f"<table class=trials>{''.join(rows)}</table>"


def _trial(trial: Trial, top: float) -> str:
    gain = trial.gain if math.isfinite(trial.gain) else 0.0
    width = 100 * math.log1p(max(gain, 0)) / math.log1p(top)
    state = "kept" if trial.kept else "refused"
    return (
        f"<tr class={state}><th>{escape(words.capital(words.named(trial)))}</th>"
        f'<td class=gain><div class=track><i style="width:{width:.1f}%"></i></div></td>'
        f"<td class=n>{words.fixed(trial.gain, 0 if abs(gain) >= 10 else 1)}</td>"
        f"<td><span class=tag>{state}</span></td><td>{escape(trial.why)}</td></tr>"
    )


def notes(texts: Sequence[str]) -> str:
    """What the data could not tell."""
    items = "".join(f"<li>{escape(t)}</li>" for t in texts)
    return f"<ul class=notes>{items}</ul>" if items else ""
