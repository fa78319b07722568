"""The page of ``replay --verify``: recorded frames and results held against replayed ones, over time and by channel."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.frames import Frames
from cellwatt.record import Recording
from cellwatt.record.messages import encode
from cellwatt.report import Axis, Block, Figure, Notes, Panel, Provenance, Report, Section, Table, Tile
from cellwatt.report.drawing import curve, upright
from cellwatt.report.numbers import number, unit
from cellwatt.report.theme import BAD, FOUND, GOOD, SIMULATION
from cellwatt.results import Result
from cellwatt.runtime.replaying import Comparison

SPANS: Final = 200
"""Parts of the time, each with its frames counted."""
MOST_CHANNELS: Final = 40
"""Named with their differences; more are counted."""
COLOURS: Final = {"equal": GOOD, "different": BAD, "only recorded": FOUND, "only replayed": SIMULATION}
LEAD: Final = "Frames in each part of the recording, by what the comparison says of them; dotted: the first difference."
COMPARED: Final = (
    "Values, quality and bound of every channel in each frame, bit by bit, frames matched by the time of their grid "
    "point; results by their content."
)


@dataclass(frozen=True)
class Difference:
    """One channel whose frames are not the same: number of frames, the first, UTC ns, and the largest, in its unit."""

    channel: str
    unit: str
    frames: int
    first: int
    largest: float


@dataclass(frozen=True)
class Coverage:
    """Times (N,), UTC ns, of the frames by what a comparison says of them, and the channels that differ."""

    times: Mapping[str, NDArray[np.int64]]
    channels: Sequence[Difference]

    @classmethod
    def of(cls, recorded: Sequence[Frames], replayed: Sequence[Frames]) -> Coverage:
        """Hold two runs of frames against each other, channel by channel where both have it."""
        ours, theirs = _joined(recorded), _joined(replayed)
        both, left, right = np.intersect1d(ours.time, theirs.time, return_indices=True)
        same = np.full(len(both), ours.columns.keys() == theirs.columns.keys())
        channels = []
        for name in ours.columns.keys() & theirs.columns.keys():
            mine, other = ours.columns[name][left], theirs.columns[name][right]
            equal = (mine == other).all(axis=1)
            same &= equal
            if not equal.all():
                apart = np.abs(mine[:, 0].view(np.float64) - other[:, 0].view(np.float64))
                largest = float(np.nanmax(apart[np.isfinite(apart)], initial=0.0))
                first = int(both[~equal][0])
                channels.append(Difference(name, ours.units[name], int((~equal).sum()), first, largest))
        times = {
            "equal": both[same],
            "different": both[~same],
            "only recorded": np.setdiff1d(ours.time, theirs.time),
            "only replayed": np.setdiff1d(theirs.time, ours.time),
        }
        return cls(times, sorted(channels, key=lambda each: (each.first, each.channel)))


@dataclass(frozen=True)
class _Run:
    """Frames by channel: value, quality and bound (N, 3), each as its bits."""

    time: NDArray[np.int64]
    columns: Mapping[str, NDArray[np.int64]]
    units: Mapping[str, str]


def _joined(blocks: Sequence[Frames]) -> _Run:
    if not blocks:
        return _Run(np.zeros(0, np.int64), {}, {})
    channels = blocks[0].layout.channels
    values = np.concatenate([np.ascontiguousarray(b.values).view(np.int64) for b in blocks])
    known = [np.concatenate([getattr(b, part) for b in blocks]).astype(np.int64) for part in ("quality", "bound")]
    columns = {c.name: np.stack([values[:, i], *(k[:, i] for k in known)], axis=1) for i, c in enumerate(channels)}
    return _Run(np.concatenate([b.time for b in blocks]), columns, {c.name: c.unit for c in channels})


def report(
    recording: Recording,
    held: Comparison,
    replayed: Sequence[Frames],
    results: Sequence[Result],
    provenance: Provenance,
) -> Report:
    """The page of a comparison of a recording with its replay's frames and results."""
    found = Coverage.of(list(recording.frames()), replayed)
    times = np.concatenate([*found.times.values()])
    origin = int(times.min()) if len(times) else 0
    first = "–" if held.first_difference is None else _when(held.first_difference, origin)
    total = held.equal + held.different + held.only_recorded + held.only_replayed
    tiles = [
        Tile(f"{kind}, frames", f"{len(at):,}", "", "good" if kind == "equal" else "bad" if len(at) else "")
        for kind, at in found.times.items()
    ]
    return Report(
        name=f"{recording.header.site}/{recording.header.cell}",
        subject="replay against recording",
        facts=[f"{total:,} frames", f"first difference: {first}"],
        verdict=(
            f"The replay is identical: {held.equal:,} frames agree in every bit."
            if held.identical
            else f"The replay is not identical: {held.equal:,} of {total:,} frames agree in every bit."
        ),
        tone="good" if held.identical else "open",
        tiles=tiles,
        sections=[
            Section("Frames over time", [_picture(found, origin)] if len(times) else [], LEAD),
            Section("Channels that differ", _channels(found.channels, origin)),
            Section(
                "Results",
                _results(recording.results(), results),
                "Results of stages in the recording, and in the replay.",
            ),
            Section("What was compared", [COMPARED]),
        ],
        provenance=provenance,
    )


def _when(at: int, origin: int) -> str:
    return f"{(at - origin) * 1e-9:.3f} s ({datetime.fromtimestamp(at * 1e-9, UTC):%H:%M:%S.%f} UTC)"


def _picture(found: Coverage, origin: int) -> Figure:
    """Frames of each kind in each part of the time."""
    times = np.concatenate([*found.times.values()])
    last = max(int(times.max()) + 1, origin + 1)
    apart = np.diff(np.unique(times))
    step = int(np.median(apart)) if len(apart) else 1
    step *= -(-(last - origin) // (SPANS * step))  # a whole number of frames, so that each part has as many
    edges = np.arange(origin, last + step, step)
    traces = []
    for kind, at in found.times.items():
        if len(at):
            counts, _ = np.histogram(at, edges)
            shown = curve(kind, counts, COLOURS[kind], start=step * 0.5e-9, step=step * 1e-9)
            traces.append({**shown, "stackgroup": "frames", "line": {**shown["line"], "shape": "hvh", "width": 0.8}})
    wrong = [at for kind, at in found.times.items() if kind != "equal" and len(at)]
    marks = [upright((min(int(at[0]) for at in wrong) - origin) * 1e-9, BAD)] if wrong else []
    x = Axis("s since the first frame", (0.0, (last - origin) * 1e-9))
    return Figure("Frames of the comparison over time", [[Panel(traces, x, Axis("frames"), marks)]], (220,))


def _channels(channels: Sequence[Difference], origin: int) -> list[Block]:
    heads = ("channel", "frames that differ", "first at", "largest difference", "unit")
    rows = [
        [each.channel, f"{each.frames}", _when(each.first, origin), number(each.largest), unit(each.unit)]
        for each in channels[:MOST_CHANNELS]
    ]
    more = len(channels) - MOST_CHANNELS
    left = [Notes([f"{more} more channels differ."])] if more > 0 else []
    return [Table("Channels that differ", heads, rows), *left] if rows else []


def _results(recorded: Iterable[Result], replayed: Iterable[Result]) -> list[Block]:
    """Results of each kind in both, and those with the same content."""
    ours, theirs = (
        Counter((type(item).__name__.lower(), encode(item)) for item in items) for items in (recorded, replayed)
    )
    if not theirs:
        return []
    kinds = sorted({kind for kind, _ in [*ours, *theirs]})
    rows = [
        [kind, *(str(sum(n for (k, _), n in c.items() if k == kind)) for c in (ours, theirs, ours & theirs))]
        for kind in kinds
    ]
    return [Table("Results", ("kind", "recorded", "replayed", "equal"), rows)]
