"""The panels of a cell as a layout file of the Foxglove app, the same for a live cell and a recording.

The packaged ``layout.json``, made for a cell like the demo's, is the template.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

from cellwatt.protobuf import identifiers
from cellwatt.record.encoder import FRAME_TOPIC
from cellwatt.record.rows import FRAME_FIELDS

if TYPE_CHECKING:
    from cellwatt.config import CellConfig

MEASURED: Final = ("supply.power", "bus.power")
"""Channels, without their source, that measure the power drawn by an arm."""
TITLE: Final = "foxglovePanelTitle"
_EFFORTS: Final = (
    ("Plot!torques", "Joint torques", "Nm", ".torque"),
    ("Plot!currents", "Joint currents", "A", ".current"),
    ("Plot!targets", "Target torques", "Nm", ".target_torque"),
)


def layout_for(channels: Mapping[str, str], models: Sequence[str]) -> dict[str, Any]:
    """The layout for frames with ``channels`` (full name → unit, in order) and the predictions of ``models``.

    A model is ``<model>`` for its output ``power``, or ``<model>/<output>``.
    """
    fields = dict(zip(channels, identifiers(list(channels), (f.name for f in FRAME_FIELDS)), strict=True))
    layout: dict[str, Any] = json.loads(files(__package__).joinpath("layout.json").read_text("utf-8"))
    panels = layout["configById"]
    plots = {
        "Plot!power": _plot(panels, "Power", "W", [*_measured(channels, fields), *_predicted(models)]),
        "Plot!positions": _plot(panels, "Joint positions", "rad", _joints(channels, fields, ".position")),
        **{
            panel: _plot(panels, title, unit, paths)
            for panel, title, unit, ending in _EFFORTS
            if (paths := _joints(channels, fields, ending))
        },
        "StateTransitions!states": {**panels["StateTransitions!states"], "paths": _states(channels)},
    }
    rest = {name: panel for name, panel in panels.items() if not name.startswith(("Plot!", "StateTransitions!"))}
    layout["configById"] = plots | rest
    layout["layout"]["first"] = _stacked(list(plots))
    return layout


def layout_of(config: CellConfig) -> dict[str, Any]:
    """The layout for the cell of a settings file, with the output ``power`` of each ``model`` stage.

    Raises ``ConfigError`` if its sources do not fit together.
    """
    from cellwatt.runtime.assemble import declared

    _, layout = declared(config)
    models = [name for name, stage in config.stages.items() if stage.kind == "model"]
    return layout_for({channel.name: channel.unit for channel in layout.channels}, models)


def _stacked(panels: Sequence[str]) -> Any:
    """Panels of the same height, one above the other."""
    if len(panels) == 1:
        return panels[0]
    first, rest = panels[0], _stacked(panels[1:])
    return {"direction": "column", "first": first, "second": rest, "splitPercentage": round(100 / len(panels))}


def _series(path: str, label: str, *, enabled: bool = True) -> dict[str, Any]:
    return {"value": path, "label": label, "enabled": enabled, "timestampMethod": "receiveTime"}


def _plot(panels: Mapping[str, Any], title: str, unit: str, paths: Iterable[dict[str, Any]]) -> dict[str, Any]:
    return {**panels["Plot!power"], TITLE: f"{title} [{unit}]", "paths": list(paths), "yAxisLabel": unit}


def _measured(channels: Mapping[str, str], fields: Mapping[str, str]) -> list[dict[str, Any]]:
    power = [name for name, unit in channels.items() if unit == "W"]
    known = [name for name in power if name.partition(".")[2] in MEASURED]
    return [_series(f"{FRAME_TOPIC}.{fields[name]}", name) for name in known or power]


def _predicted(models: Sequence[str]) -> list[dict[str, Any]]:
    """Series of the newest value of each block, at the message's time, and, disabled, of the oldest value."""
    found = []
    for told in models:
        model, _, output = told.partition("/")
        path = f'/prediction{{model=="{model}"}}.outputs.{output or "power"}'
        found.append(_series(f"{path}[-1]", f"predicted ({told})"))
        found.append(_series(f"{path}[0]", f"predicted ({told}), first of each block", enabled=False))
    return found


def _joints(channels: Mapping[str, str], fields: Mapping[str, str], ending: str) -> list[dict[str, Any]]:
    wanted = (name for name in channels if ".joint_" in name and name.endswith(ending))
    return [_series(f"{FRAME_TOPIC}.{fields[name]}", name) for name in wanted]


def _states(channels: Mapping[str, str]) -> list[dict[str, Any]]:
    arms = dict.fromkeys(name.partition(".")[0] for name in channels if name.endswith(".joint_1.position"))
    paths = [_series("/health.status.state", "health")]
    for arm in arms:
        paths.append(_series(f'/interval{{source=="{arm}"}}.number', f"{arm}: interval"))
        paths.append(_series(f'/task{{source=="{arm}"}}.name', f"{arm}: task that ended"))
    return paths


def text_of(layout: Mapping[str, Any]) -> str:
    """A layout as text for a file."""
    return json.dumps(layout, indent=2, ensure_ascii=False) + "\n"
