"""Draws the pictures of docs/architecture.md: boxes on a grid, joined by arrows.

python bench/architecture.py docs/pictures
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path

WIDTH, ACROSS, HEIGHT, DOWN, EDGE = 196, 44, 76, 22, 16
"""Pixels: width of a box, gap beside it, height, gap below it, margin."""
COLOURS = {
    "outside": ("#e3f2fd", "#64b5f6"),
    "code": ("#e8f5e9", "#81c784"),
    "queue": ("#fff3e0", "#ffb74d"),
    "file": ("#eceff1", "#90a4ae"),
    "robot": ("#f3e5f5", "#ba68c8"),
}
"""Fill and border by kind of box."""
LEGEND = {"outside": "outside", "code": "code", "queue": "ring or queue", "file": "file", "robot": "robot room"}


@dataclass(frozen=True)
class Box:
    """A box at ``column`` and ``row`` (fractions allowed) with a ``title`` and up to three lines of ``text``."""

    column: float
    row: float
    kind: str
    title: str
    text: str = ""

    @property
    def left(self) -> float:
        """Left edge, pixels."""
        return EDGE + self.column * (WIDTH + ACROSS)

    @property
    def top(self) -> float:
        """Upper edge, pixels."""
        return EDGE + self.row * (HEIGHT + DOWN)

    def drawn(self) -> str:
        """SVG of the box."""
        fill, border = COLOURS[self.kind]
        lines = self.text.split("\n") if self.text else []
        middle, first = self.left + WIDTH / 2, self.top + HEIGHT / 2 + 5 - 7.5 * len(lines)
        out = [
            f'<rect x="{self.left:.0f}" y="{self.top:.0f}" width="{WIDTH}" height="{HEIGHT}" rx="8" fill="{fill}" '
            f'stroke="{border}" stroke-width="1.5"/>',
            f'<text x="{middle:.0f}" y="{first:.1f}" text-anchor="middle" '
            f'font-weight="bold">{escape(self.title)}</text>',
        ]
        out += [
            f'<text x="{middle:.0f}" y="{first + 15 * (n + 1):.1f}" text-anchor="middle" font-size="11.5" '
            f'fill="#546e7a">{escape(line)}</text>'
            for n, line in enumerate(lines)
        ]
        return "\n".join(out)


def arrow(a: Box, b: Box) -> str:
    """SVG of an arrow from one box to another: sideways between columns, up or down within one."""
    if abs(a.column - b.column) < 0.5:
        x, down = a.left + WIDTH / 2, b.row > a.row
        points = (x, a.top + (HEIGHT if down else 0)), (b.left + WIDTH / 2, b.top + (0 if down else HEIGHT))
    else:
        right = b.column > a.column
        points = (
            (a.left + (WIDTH if right else 0), a.top + HEIGHT / 2),
            (b.left + (0 if right else WIDTH), b.top + HEIGHT / 2),
        )
    (x1, y1), (x2, y2) = points
    return (
        f'<line x1="{x1:.0f}" y1="{y1:.0f}" x2="{x2:.0f}" y2="{y2:.0f}" stroke="#546e7a" stroke-width="1.6" '
        'marker-end="url(#a)"/>'
    )


def picture(boxes: Mapping[str, Box], arrows: str) -> str:
    """An SVG of ``boxes`` by name, with ``arrows`` like ``"a>b a>c"`` and a legend of the kinds used."""
    kinds = [kind for kind in LEGEND if any(box.kind == kind for box in boxes.values())]
    width = max(box.left for box in boxes.values()) + WIDTH + EDGE
    bottom = max(box.top for box in boxes.values()) + HEIGHT + EDGE
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {bottom + 24:.0f}" '
        'font-family="Helvetica,Arial,sans-serif" font-size="14" fill="#263238">',
        '<defs><marker id="a" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" '
        'orient="auto"><path d="M0 0L10 5L0 10z" fill="#546e7a"/></marker></defs>',
        f'<rect width="{width:.0f}" height="{bottom + 24:.0f}" fill="#ffffff"/>',
    ]
    out += [arrow(*(boxes[name] for name in each.split(">"))) for each in arrows.split()]
    out += [box.drawn() for box in boxes.values()]
    for n, kind in enumerate(kinds):
        x, (fill, border) = EDGE + 130 * n, COLOURS[kind]
        out.append(f'<rect x="{x}" y="{bottom}" width="14" height="14" rx="3" fill="{fill}" stroke="{border}"/>')
        out.append(f'<text x="{x + 20}" y="{bottom + 11.5}" font-size="11.5" fill="#546e7a">{LEGEND[kind]}</text>')
    return "\n".join([*out, "</svg>", ""])


def collect() -> str:
    """Devices to the raw ring."""
    return picture(
        {
            "push": Box(0, 0, "outside", "devices that push", "UR, ABB, Franka, CAN,\npower board"),
            "poll": Box(0, 1, "outside", "devices that are polled", "Yaskawa, Kinova, Modbus,\nSCPI"),
            "driver": Box(1, 0.5, "code", "drivers", "one asyncio task per source,\nrestarted with back-off"),
            "limit": Box(2, 0, "code", "allowance", "4 × declared rate, 30 s backlog;\nbeyond: dropped, counted"),
            "account": Box(2, 1, "code", "account", "expected =\nreceived + missed + dropped"),
            "clock": Box(3, 0, "code", "clock model", "device time → cell time ± bound;\nsequence numbers"),
            "ring": Box(4, 0, "queue", "raw ring", "10 s, 4–64 MB; never blocks,\noldest overwritten"),
            "out": Box(4, 1, "code", "align and tell", "read the ring at their own pace"),
        },
        "push>driver poll>driver driver>limit driver>account limit>clock clock>ring ring>out",
    )


def judge() -> str:
    """The raw ring to frames and results."""
    return picture(
        {
            "raw": Box(0, 0.5, "queue", "raw ring", "10 s, 4–64 MB"),
            "align": Box(
                1,
                0.5,
                "code",
                "process align",
                "all channels on one grid;\nwaits ≤ latency (100 ms),\nthen marks values missing",
            ),
            "frames": Box(2, 0.5, "queue", "frame ring", "10 s, 4–64 MB; never blocks,\noldest overwritten"),
            "one": Box(
                3,
                0,
                "code",
                "process judge: chain 1",
                "e.g. segment → faults;\n≤ 500 frames behind, then the\noldest are dropped, counted",
            ),
            "two": Box(3, 1, "code", "process judge: chain 2", "e.g. models; nice 5, 2 GiB,\nrestarted alone"),
            "r1": Box(4, 0, "queue", "result ring", "4 MB per chain"),
            "r2": Box(4, 1, "queue", "result ring", "4 MB per chain"),
        },
        "raw>align align>frames frames>one frames>two one>r1 two>r2",
    )


def tell() -> str:
    """Rings to record, bus and health."""
    return picture(
        {
            "raw": Box(0, 0, "queue", "raw ring", "samples, ticks, events"),
            "frames": Box(0, 1, "queue", "frame ring", "frames"),
            "results": Box(0, 2, "queue", "result rings", "results and alarms of stages"),
            "tell": Box(1, 1, "code", "teller", "settings change behind the\nlast sample of the old ones"),
            "recorder": Box(2, 0, "queue", "recorder queue", "64 MB; what does not fit is\ndropped, counted"),
            "outbox": Box(2, 1, "queue", "outbox", "4096 messages; oldest raw goes\nfirst, results last; counted"),
            "watch": Box(2, 2, "code", "health and alarms", "alarm book: patience, damping,\nacknowledge, shelve"),
            "files": Box(3, 0, "file", "MCAP recordings", "flush 50 ms, sync 1 s;\nbudget: oldest files go"),
            "bus": Box(4, 1, "outside", "Zenoh", "samples, frames, results,\nalarms, health"),
            "answers": Box(3, 2, "code", "answers", "record, last 4096 alarms,\n4 MB of frames"),
            "journal": Box(1, 2, "queue", "journal rings", "2 MB alarms, 4 MB results,\nfor a restarted tell"),
        },
        "raw>tell frames>tell results>tell tell>recorder tell>outbox tell>watch watch>outbox recorder>files outbox>bus "
        "files>answers answers>bus tell>journal",
    )


def packages() -> str:
    """The three packages and who may import whom."""
    return picture(
        {
            "drivers": Box(0, 0, "code", "cellwatt_drivers", "a folder per device family,\nand the room they share"),
            "methods": Box(
                2, 0, "code", "cellwatt_plugins", "segment, models, faults,\nmismatch, energy:\nnever import each other"
            ),
            "robot": Box(2, 1.2, "robot", "cellwatt_plugins.robot", "the arm; imports no plugin"),
            "core": Box(1, 1.2, "code", "cellwatt", "the daemon; imports neither,\nfinds them by entry point"),
            "tests": Box(1, 0, "outside", "tests, bench, fuzz", "may import all"),
        },
        "drivers>core methods>robot methods>core robot>core tests>core",
    )


def segment() -> str:
    """Positions to intervals and tasks."""
    return picture(
        {
            "frames": Box(0, 0, "queue", "frames", "joint positions"),
            "files": Box(0, 1, "file", "recordings", "replay, plot, reference"),
            "noise": Box(1, 0.5, "code", "noise, motion", "speed thresholds above the\nencoder noise"),
            "cut": Box(2, 0.5, "code", "intervals", "same joints moving"),
            "tasks": Box(3, 0.5, "code", "tasks", "recurring sequences"),
            "out": Box(4, 0.5, "outside", "Interval, Task", "for faults, energy, mismatch\nand subscribers"),
        },
        "frames>noise files>noise noise>cut cut>tasks tasks>out",
    )


def models() -> str:
    """Training and running models."""
    return picture(
        {
            "files": Box(0, 0, "file", "recordings, tables", "moves or held poses"),
            "robot": Box(1, 1, "robot", "robot", "body, drive, friction,\nmeter, collision"),
            "train": Box(
                1, 0, "code", "train static, train power", "physics first, then what it\nleaves over; held-out errors"
            ),
            "graph": Box(2, 0, "code", "graph", "formulas and networks as ONNX"),
            "onnx": Box(3, 0, "file", "model.onnx", "inputs, units, robot, ranges"),
            "frames": Box(2, 1, "queue", "frames", "window of frames"),
            "stage": Box(3, 1, "code", "stage model", "onnxruntime; missing in,\nmissing out"),
            "out": Box(4, 1, "outside", "Prediction, Alarm", "model_outside_range"),
            "check": Box(4, 0, "code", "check, predict", "refuses a model that does\nnot fit the cell"),
        },
        "files>train robot>train train>graph graph>onnx onnx>stage onnx>check frames>stage stage>out",
    )


def faults() -> str:
    """Learning references and judging cycles."""
    return picture(
        {
            "healthy": Box(0, 0, "file", "healthy recordings", "cycles of known tasks"),
            "learn": Box(
                1, 0, "code", "reference, faults train", "patterns, BEVF equations,\nnetworks of fault tables"
            ),
            "reference": Box(2, 0, "file", "reference.yaml, *.onnx", "per task and variant"),
            "robot": Box(3, 0, "robot", "robot", "body, friction, drive, motion,\nregression, meter"),
            "offline": Box(1, 1, "file", "recording to judge", "cellwatt faults"),
            "live": Box(1, 2, "queue", "frames, Interval, Task", "from segment"),
            "match": Box(2, 1.5, "code", "match", "cycle to variant; power and\nposition against reference"),
            "paper": Box(3, 2, "code", "faults_by_paper", "(16), rules, codes (20),\nfault table or network"),
            "explain": Box(3, 1, "code", "cycles: explain", "which joint's motion explains\nthe residual"),
            "out": Box(4, 1.5, "outside", "Alarm", "joint_fault, encoder_fault"),
        },
        "healthy>learn learn>reference reference>match robot>explain offline>match live>match match>explain "
        "match>paper explain>out paper>out",
    )


def mismatch() -> str:
    """Explaining the difference between recording and simulation."""
    return picture(
        {
            "files": Box(0, 0, "file", "recording, simulation", "robot.yaml, URDF"),
            "admit": Box(1, 0, "code", "input: admission", "time, signs, units, noise;\nbaseline = user's simulation"),
            "fit": Box(2, 0, "code", "fit: search", "add the effect with most\nevidence; cross-validate"),
            "robot": Box(2, 1, "robot", "robot", "effects, body, priors,\nregression, drive"),
            "verdict": Box(3, 0, "code", "verdict", "statement, interval, unknown"),
            "model": Box(4, 0, "file", "model.yaml, report", "simulate; --mend writes the\nMuJoCo file or URDF"),
            "frames": Box(0, 2, "queue", "frames", "measured, and a simulated or\nstreamed twin"),
            "band": Box(1, 2, "code", "live: band, watch", "noise band per channel"),
            "alarm": Box(2, 2, "outside", "Alarm", "simulation_differs"),
            "job": Box(3, 2, "code", "live: explainer", "runs the path above in its own\nprocess, at lowest priority"),
            "said": Box(4, 2, "outside", "Alarm, report", "mismatch: what explains it"),
        },
        "files>admit admit>fit robot>fit fit>verdict verdict>model frames>band band>alarm alarm>job job>said",
    )


def energy() -> str:
    """A campaign, and the live split."""
    return picture(
        {
            "guide": Box(0, 0, "code", "energy-campaign", "programs, measuring, log"),
            "files": Box(1, 0, "file", "campaign recordings", "rests, speeds, payloads"),
            "identify": Box(2, 0, "code", "disaggregate: identify", "clock, torque factors,\ndrive parameters"),
            "robot": Box(2, 1, "robot", "robot", "body, priors, regression,\ndrive, friction, collision"),
            "runs": Box(3, 0, "code", "split, runs, spread", "groups with uncertainties"),
            "report": Box(4, 0, "file", "energy.json, report", "parameters and covariance"),
            "frames": Box(3, 1, "queue", "frames, Task", "from segment"),
            "stage": Box(4, 1, "code", "stage energy", "follow, balance, advice"),
            "out": Box(4, 2, "outside", "Energy, Alarm", "energy_balance,\nenergy_advice_…"),
        },
        "guide>files files>identify robot>identify identify>runs runs>report report>stage frames>stage stage>out",
    )


PICTURES = (collect, judge, tell, packages, segment, models, faults, mismatch, energy)

if __name__ == "__main__":
    for draw in PICTURES:
        (Path(sys.argv[1]) / f"architecture-{draw.__name__}.svg").write_text(draw(), encoding="utf-8")
