"""Findings of ``explain`` as cards, bars and tables."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cellwatt.report import Bars, Block, Card, Columns, Folded, Html, Notes, Table, Tile, quiet
from cellwatt.report.blocks import bar, bold, inline
from cellwatt.report.numbers import capital, decimals_for, fixed, listed, measured, times, unit
from cellwatt_plugins.explain.fit.solution import Trial
from cellwatt_plugins.explain.report import wording
from cellwatt_plugins.explain.verdict.findings import (
    ChannelFit,
    Finding,
    Findings,
    Improvement,
    Other,
    UnexplainedChannel,
    Where,
)

Row = list[str]
KINDS = {"missing": "missing from the simulation", "structure": "built differently", "mistuned": "value is off"}
_KINDS = ("refused", "kept")
MOST_TRIALS = 16
"""Number of candidates shown at once; the rest is folded."""
MOST_OTHERS = 12
"""Number of recordings shown at once; the rest is folded."""


def tiles(fit: Sequence[ChannelFit]) -> list[Tile]:
    """Error of the worst channel before and after, in noise floors."""
    out = []
    for key, label in (("simulation", "Simulation"), ("refit", "Simulation, retuned"), ("model", "Model")):
        ratios = [(getattr(f, key) / f.noise_floor, f.channel) for f in fit]
        if ratios:
            worst, channel = max(ratios)
            middle = f"; median of all {times(float(np.median([r for r, _ in ratios])))}" if len(ratios) > 1 else ""
            out.append(Tile(label, times(worst), wording.channel_name(channel) + middle, key))
    return out


def found(findings: Findings) -> list[Block]:
    """A card for each finding and for each channel that stays unexplained."""
    units = {f.channel: f.unit for f in findings.fit}
    rests = [_unexplained_card(r, units.get(r.channel, "")) for r in findings.without_finding]
    return [*(_finding_card(f) for f in findings.findings), *rests]


def _finding_card(finding: Finding) -> Card:
    """One finding: effect, parameters, confidence, location, improvement and alternatives."""
    unknown = finding.effect == wording.UNKNOWN
    kind = KINDS[finding.kind]
    rows = [
        (name.replace("_", " "), inline(bold(measured(p.value, p.std)), " ", unit(p.unit)))
        for name, p in finding.parameters.items()
    ]
    left: list[Block] = [Table("Parameters", (), rows)] if rows else []
    gain = finding.improvement
    right = _improvement(gain) if finding.followed else [_remains(gain.after, gain.unit, gain.noise_floor)]
    others = [inline(bold(capital(wording.named(o))), ": ", o.why) for o in finding.alternatives]
    more: list[Block] = [Html("<h4>Could also be</h4>"), Notes(others)] if others else []
    blocks = [finding.statement, Columns([*left, *_where(finding.where, gain.unit)], right), *more]
    title, sure = capital(wording.named(finding)), wording.confidence(finding.confidence)
    style = "open" if unknown else "mistuned" if finding.kind == "mistuned" else "missing"
    return Card(title, blocks, "not explained" if unknown else kind, sure, style)


def _unexplained_card(rest: UnexplainedChannel, symbol: str) -> Card:
    """A channel that stays above its noise floor, in the unit ``symbol``."""
    place = Where((rest.channel,), rest.position, rest.velocity)
    columns = Columns(_where(place, symbol), [_remains(rest.rms, symbol, rest.noise_floor)])
    aside = f"{times(rest.rms / rest.noise_floor)} the noise"
    title = capital(wording.channel_name(rest.channel))
    tag = "not explained" if rest.looked_at else "not looked at"
    return Card(title, [rest.statement, columns], tag, aside, "open")


def _where(where: Where, symbol: str) -> list[Block]:
    """Channels, velocity, position and times; ``symbol`` is the unit of the main channel, N of a linear axis."""
    linear, texts = symbol == "N", list[str]()
    if where.channels:
        more = len(where.channels) - 3
        parts = listed([wording.channel_name(c) for c in where.channels[:3]])
        texts.append(parts + (f" and {more} more" if more > 0 else ""))
    if where.velocity:
        texts.append(f"at {wording.between(where.velocity, 'm/s' if linear else 'rad/s')}")
    if where.position:
        texts.append(f"at {wording.between(where.position, 'm') if linear else wording.degrees(where.position)}")
    if where.times:
        texts.append(f"in {wording.moments(where.times)}")
    return [Html(f"<p>{inline(bold('Where'), ' ', '; '.join(texts))}</p>")] if texts else []


def _improvement(gain: Improvement) -> list[Block]:
    bars = Bars([("without", "simulation", gain.before), ("with", "model", gain.after)], gain.unit, gain.noise_floor)
    data = "data left out of the fit" if gain.held_out else "the data of the fit"
    span = gain.before - gain.noise_floor
    closed = (gain.before - gain.after) / span if span > 0 else math.nan
    outcome = f"{_share(closed)} of the error beyond the noise is gone. " if math.isfinite(closed) else ""
    outcome = "Worse with it. " if gain.after > gain.before else outcome
    channel = capital(wording.channel_name(gain.channel))
    return [bars, quiet(inline(bold(outcome), f"{channel}, rms on {data}; your numbers unchanged."))]


def _share(closed: float) -> str:
    percent = 100 * min(closed, 1)
    return f"{percent:.0f} %" if percent >= 1 else "Less than 1 %"


def _remains(rms: float, symbol: str, floor: float) -> Bars:
    return Bars([("remains", "model", rms)], symbol, floor)


def others_table(others: Sequence[Other]) -> list[Block]:
    """Recordings that were not used for fitting, the worst fit first."""
    order = sorted(others, key=lambda o: (o.explained is not None, o.explained is True, -o.error / (o.usual or 1)))
    heads = ("recording", "channel furthest off", "error, rms", "of the usual", "")
    return _first("Other recordings", heads, [(bool(o.explained), _other(o)) for o in order], MOST_OTHERS)


def _other(other: Other) -> Row:
    if other.explained is None:
        return [other.recording, "", "", "", f"not compared: {other.why}"]
    error = f"{fixed(other.error, decimals_for(other.usual))} {unit(other.unit)}"
    state, ratio = _tag("explained" if other.explained else "differs"), times(other.error / other.usual)
    return [other.recording, capital(wording.channel_name(other.channel)), error, ratio, state]


def trials(tried: Sequence[Trial]) -> list[Block]:
    """Candidates by evidence, each with the reason for its acceptance or rejection."""
    order = sorted(tried, key=lambda t: (-t.kept, -t.gain))
    top = max([1.0, *(t.gain for t in tried)])
    heads = ("candidate", "", "evidence, nats", "", "why")
    return _first("Candidates", heads, [(t.kept, _trial(t, top)) for t in order], MOST_TRIALS)


def _trial(trial: Trial, top: float) -> Row:
    share = bar(math.log1p(max(trial.gain, 0)) / math.log1p(top))
    nats = fixed(trial.gain, 0 if abs(trial.gain) >= 10 else 1)
    return [capital(wording.named(trial)), share, nats, _tag(_KINDS[trial.kept]), trial.why]


def _first(title: str, heads: Sequence[str], rows: Sequence[tuple[bool, Row]], most: int) -> list[Block]:
    """A table of the first rows, and a folded table of the rest; each row is marked good or not."""
    tables = [
        Table(title, heads, [row for _, row in some], [_KINDS[good] for good, _ in some])
        for some in (rows[:most], rows[most:])
        if some
    ]
    return [*tables[:1], *(Folded(f"{len(rows) - most} more", [table]) for table in tables[1:])]


def _tag(text: str) -> Html:
    return Html(f"<span class=tag>{text}</span>")
