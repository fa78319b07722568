"""Pictures of the stories for ``docs/proof-real.md``, as plotly figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from real import kr300, ur10e
from real.course import Course, course
from real.recording import Float, Recording

Figure = dict[str, Any]
Figures = Mapping[str, Any]
MEASURED, SIMULATION, MODEL, TRUE = "#9aa3ad", "#e07b39", "#2f6fb1", "#3a8f4d"
FONT = {"family": "Helvetica, Arial, sans-serif", "size": 12, "color": "#263238"}
AXIS = {"gridcolor": "#e3e7ea", "zerolinecolor": "#b0b8bf", "linecolor": "#b0b8bf", "ticks": ""}
WIDTH = 760
EXCERPT = (20.0, 29.0)
"""s of the payload's recording that are drawn."""
CONTACT = (14.2, 16.2)
"""s of the recording in which the arm touches something."""
BEHIND = 1.24
"""s by which the recording without load starts later on the same motion."""
TICKS = [1, 2, 5, 10, 20, 50, 100, 200]
"""Of logarithmic axes."""
BINS, FEWEST = 30, 8
"""Bins of velocity, and samples from which one is drawn."""


def masses(figures: Figures) -> Figure:
    """Masses with their 95 % intervals beside the weighed one."""
    rows = [(f"plain fit, {name} gains", mass, None) for name, mass in figures["plain_fit"].items()]
    for key, told in figures.items():
        if isinstance(told, dict) and told.get("payload"):
            name, recording = key.split("/")
            load = "other load, " if recording == ur10e.OTHER_LOAD else ""
            rows.append((f"explain, {load}{name} gains", told["payload"]["mass"], told["payload"]["interval"]))
    rows.reverse()
    names, values = [row[0] for row in rows], [row[1] for row in rows]
    up, down = ([abs((end or (v, v))[i] - v) for _, v, end in rows] for i in (1, 0))
    error = {"type": "data", "symmetric": False, "array": up, "arrayminus": down, "thickness": 2}
    dots = {"x": values, "y": names, "error_x": error, "mode": "markers", "marker": {"size": 9, "color": MODEL}}
    true = figures["true_mass"]
    line = {"type": "line", "x0": true, "x1": true, "y0": 0, "y1": 1, "yref": "paper", "line": {"color": TRUE}}
    said = {
        "x": true,
        "y": 1.0,
        "yref": "paper",
        "yanchor": "bottom",
        "text": f"weighed: {true} kg",
        "showarrow": False,
    }
    axes = {"xaxis": AXIS | {"title": {"text": "kg"}}, "yaxis": AXIS | {"automargin": True}}
    return _figure(
        [dots], axes | {"shapes": [line], "annotations": [said | {"font": {"color": TRUE}}]}, 60 + 34 * len(rows)
    )


def torques(told: Course, joints: Sequence[int], span: tuple[float, float]) -> Figure:
    """Measured, simulated and modelled torque of some joints (0-based) over a stretch of time."""
    at = (told.time >= span[0]) & (told.time <= span[1])
    curves = (("measured", told.measured, MEASURED), ("simulation", told.simulation, SIMULATION))
    traces = [
        _line(told.time[at], values[at, joint], name, colour, row, first=row == 1)
        for row, joint in enumerate(joints, start=1)
        for name, values, colour in (*curves, ("model", told.model, MODEL))
    ]
    return _stacked(traces, [f"joint {joint + 1}, Nm" for joint in joints], "s", 190)


def friction_left(told: Course, joints: Sequence[int]) -> Figure:
    """What is left of joints' torques by velocity, for the simulation and for the model."""
    traces = []
    for row, joint in enumerate(joints, start=1):
        for name, said, colour in (("simulation", told.simulation, SIMULATION), ("model", told.model, MODEL)):
            left = told.measured[:, joint] - said[:, joint]
            traces.append(_medians(told.velocity[:, joint], left, name, colour, row, first=row == 1))
    return _stacked(traces, [f"joint {joint + 1}: left, Nm" for joint in joints], "rad/s", 220)


def contact(loaded: Recording, empty: Recording, joints: Sequence[int]) -> Figure:
    """Motor currents with and without load on the same motion, at the time of the contact."""
    traces = []
    for row, joint in enumerate(joints, start=1):
        for name, recording, later, colour in (("no load", empty, BEHIND, MEASURED), ("load", loaded, 0.0, SIMULATION)):
            time = recording.time + later
            at = (time >= CONTACT[0]) & (time <= CONTACT[1])
            assert recording.current is not None
            traces.append(_line(time[at], recording.current[at, joint], name, colour, row, first=row == 1))
    return _stacked(traces, [f"joint {joint + 1}, A" for joint in joints], "s", 170)


def balanced(told: Sequence[Course], joint: int) -> Figure:
    """What is left of a joint's torque by its angle, for the simulation and for the model, and the true balancer."""
    angle = np.concatenate([one.position[:, joint] for one in told])
    measured = np.concatenate([one.measured[:, joint] for one in told])
    curves = (("simulation", [one.simulation for one in told], SIMULATION), ("model", [o.model for o in told], MODEL))
    traces = [
        _medians(angle, measured - np.concatenate(said)[:, joint], name, colour, 1, first=True)
        for name, said, colour in curves
    ]
    places = np.linspace(angle.min(), angle.max(), 100)
    traces.append(_line(places, kr300.balancer(places), "published balancer", TRUE, 1, first=True))
    return _stacked(traces, [f"joint {joint + 1}: left, Nm"], "rad", 320)


def over_floor(told: Mapping[str, Figures]) -> Figure:
    """Held-out error over the noise floor of every joint of some explanations: simulation, retuned, with the model."""
    traces, highest = [], 1.0
    for row, figures in enumerate(told.values(), start=1):
        for name, key, colour in (("simulation", "simulation", SIMULATION), ("model", "model", MODEL)):
            joints = [fit["channel"].replace("tau_", "joint ") for fit in figures["fit"]]
            values = [fit[key] / fit["noise_floor"] for fit in figures["fit"]]
            highest = max(highest, *values)
            traces.append(_bars(joints, values, name, colour, row))
    figure = _stacked(traces, [f"{name}<br>error ÷ floor" for name in told], "", 170)
    for row in range(1, len(told) + 1):
        figure["layout"][f"yaxis{row}"] |= {
            "type": "log",
            "tickvals": TICKS,
            "range": [np.log10(0.8), np.log10(1.2 * highest)],
        }
    figure["layout"]["shapes"] = [_one(row) for row in range(1, len(told) + 1)]
    return figure


def cold_over_warm(figures: Figures) -> Figure:
    """Friction at half speed of an earlier run over that of a later one: the cold pair, and a pair minutes apart."""
    joints = [f"joint {j}" for j in range(1, 7)]
    pairs = (("cold ÷ warm", "friction_cold_over_warm", SIMULATION), ("both warm", "friction_warm_over_warm", MEASURED))
    traces = [_bars(joints, [100 * (r - 1) for r in figures[key]], name, colour, 1) for name, key, colour in pairs]
    return _stacked(traces, ["more friction, %"], "", 240)


def of_payload(data: Path, work: Path, figures: Figures) -> dict[str, Figure]:
    """The payload: masses, torques, and the contact in the other load's recording."""
    folder = work / "payload" / "published"
    loaded = ur10e.read(data, ur10e.LOAD)
    told = course(loaded, folder / "robot.yaml", folder / ur10e.LOAD)
    others = ur10e.read(data, ur10e.OTHER_LOAD), ur10e.read(data, ur10e.OTHER_NO_LOAD)
    return {
        "proof-real-payload": masses(figures),
        "proof-real-torque": torques(told, (1, 3), EXCERPT),
        "proof-real-contact": contact(*others, (0, 1, 3)),
        "proof-real-payload-error": over_floor({"payload": figures[f"published/{ur10e.LOAD}"]}),
    }


def of_friction(data: Path, work: Path, figures: Figures) -> dict[str, Figure]:
    """Friction left out: what it leaves over velocity."""
    folder = work / "friction"
    told = course(ur10e.read(data, ur10e.UNSEEN_NO_LOAD), folder / "robot.yaml", folder / "out")
    return {"proof-real-friction": friction_left(told, (1, 3))}


def of_warm(data: Path, work: Path, figures: Figures) -> dict[str, Figure]:
    """Cold against warm."""
    return {"proof-real-warm": cold_over_warm(figures)}


def of_lwr(data: Path, work: Path, figures: Figures) -> dict[str, Figure]:
    """KUKA: error over floor with both models."""
    return {"proof-real-kuka": over_floor({n: told for n, told in figures.items() if "fit" in told})}


def of_franka(data: Path, work: Path, figures: Figures) -> dict[str, Figure]:
    """Panda: error over floor without and with friction."""
    return {"proof-real-panda": over_floor({n: told for n, told in figures.items() if "fit" in told})}


def of_balancer(data: Path, work: Path, figures: Figures) -> dict[str, Figure]:
    """KR 300: what the described arm leaves of joint 2's torque by its angle, and the published balancer."""
    folder = work / "balancer" / "friction_told"
    told = [course(kr300.read(data, run), folder / "robot.yaml", folder / "out") for run in kr300.RUNS]
    return {"proof-real-balancer": balanced(told, kr300.BALANCED)}


PICTURES: Mapping[str, Callable[[Path, Path, Figures], dict[str, Figure]]] = {
    "payload": of_payload,
    "friction": of_friction,
    "warm": of_warm,
    "lwr": of_lwr,
    "franka": of_franka,
    "balancer": of_balancer,
}
"""The pictures of each story: from the data folder, the work folder and the story's figures."""


def _line(x: Any, y: Any, name: str, colour: str, row: int, first: bool) -> Figure:
    place = {"xaxis": "x", "yaxis": f"y{row}", "showlegend": first, "legendgroup": name}
    points = {"x": np.round(x, 4).tolist(), "y": np.round(y, 3).tolist()}
    return {"mode": "lines", "name": name, "line": {"color": colour, "width": 1.3}} | points | place


def _medians(x: Float, y: Float, name: str, colour: str, row: int, first: bool) -> Figure:
    """Median of y in equal bins of x, with the range that holds 80 %."""
    edges = np.linspace(*np.quantile(x, [0.01, 0.99]), BINS + 1)
    parts = [(x >= low) & (x < high) for low, high in pairwise(edges)]
    told = np.array(
        [[x[part].mean(), *np.quantile(y[part], [0.1, 0.5, 0.9])] for part in parts if part.sum() >= FEWEST]
    )
    middle, low, median, high = told.T
    bars = {"array": (high - median).round(3).tolist(), "arrayminus": (median - low).round(3).tolist()}
    marks = {"mode": "markers", "marker": {"size": 6, "color": colour}}
    spread = {"error_y": {"type": "data", "symmetric": False, "width": 0, "thickness": 1.5} | bars}
    return _line(middle, median, name, colour, row, first) | marks | spread


def _bars(x: Sequence[str], y: Sequence[float], name: str, colour: str, row: int) -> Figure:
    place = {"xaxis": "x", "yaxis": f"y{row}", "showlegend": row == 1, "legendgroup": name}
    return {"type": "bar", "x": list(x), "y": list(y), "name": name, "marker": {"color": colour}} | place


def _one(row: int) -> Figure:
    """The noise floor itself."""
    line = {"color": TRUE, "width": 1.5, "dash": "dot"}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": f"y{row}", "y0": 1, "y1": 1, "line": line}


def _stacked(traces: list[Figure], titles: Sequence[str], below: str, height: int) -> Figure:
    """Rows over one another on one x axis."""
    rows, gap = len(titles), 0.06
    share = (1 - gap * (rows - 1)) / rows
    axes: Figure = {"xaxis": AXIS | {"title": {"text": below}, "anchor": f"y{rows}"}}
    for row, title in enumerate(titles, start=1):
        top = 1 - (row - 1) * (share + gap)
        axes[f"yaxis{row}"] = AXIS | {"title": {"text": title}, "domain": [max(0.0, top - share), top]}
    return _figure(traces, axes, 70 + height * rows)


def _figure(traces: list[Figure], layout: Figure, height: int) -> Figure:
    common = {"template": "none", "paper_bgcolor": "#ffffff", "plot_bgcolor": "#ffffff", "font": FONT}
    legend = {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"}
    margin = {"l": 75, "r": 20, "t": 35, "b": 45}
    size = {"width": WIDTH, "height": height, "margin": margin, "legend": legend}
    return {"data": [{"type": "scatter"} | trace for trace in traces], "layout": common | size | layout}
