"""The live cell as text: what ``watch`` and ``demo`` show."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from cellwatt.commands.live_power import LivePower

COLOUR = {"ok": "green", "green": "green", "starting": "yellow", "amber": "yellow", "retrying": "red", "red": "red"}
SEVERITY = {"info": "cyan", "warning": "yellow", "error": "bold red"}


@dataclass
class LiveCell:
    """State of a cell as its messages tell it; ``add`` takes them in order of arrival."""

    status: Mapping[str, Any] = field(default_factory=dict)
    alarms: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    intervals: deque[Mapping[str, Any]] = field(default_factory=lambda: deque(maxlen=6))
    task: Mapping[str, Any] | None = None
    energy: Mapping[str, Any] | None = None
    power: LivePower = field(default_factory=LivePower)

    def add(self, kind: str, message: Mapping[str, Any]) -> None:
        """Take a message of kind health, alarm, interval, task, energy, prediction or frame; others are ignored."""
        if kind == "health":
            self.status = message
        elif kind == "alarm":
            if message["active"]:
                self.alarms[message["id"]] = message
            else:
                self.alarms.pop(message["id"], None)
        elif kind == "interval" and message["closed"]:
            self.intervals.append(message)
        elif kind == "task":
            self.task = message
        elif kind == "energy":
            self.energy = message
        elif kind == "prediction":
            self.power.add_prediction(message)
        elif kind == "frame":
            self.power.add_frames(message)

    def render(self, title: str = "") -> RenderableType:
        """Render the state for one screen."""
        if not self.status:
            return Text("waiting for the cell's first health message …", style="dim")
        energy = [self._energy(self.energy)] if self.energy else []
        parts = (self._head(title), self._sources(), self._motion(), *energy, *self.power.lines(), self._alarms())
        return Group(*parts)

    def _head(self, title: str) -> Text:
        s = self.status
        text = Text(f"{title}{s['site']}/{s['cell']} ", style="bold")
        text.append(f"● {s['state']}", style=COLOUR[s["state"]])
        recorder = s["recorder"]
        disk = f" · recorder {recorder['state']}" if recorder else " · not recording"
        text.append(f"   {s['frames']['count']} frames · {s['results']} results{disk}", style="dim")
        text.append(f"   {time.strftime('%H:%M:%S', time.gmtime(s['time'] * 1e-9))} UTC", style="dim")
        for warning in s.get("warnings", ()):
            text.append(f"\nwarning: {warning}", style="yellow")
        return text

    def _sources(self) -> Table:
        table = Table(box=None, header_style="bold", padding=(0, 1))
        columns = ("source", "state", "stream", "rate", "jitter p99", "clock ±", "expected", "received", "lost", "note")
        for name in columns:
            right = name in {"rate", "jitter p99", "clock ±", "expected", "received", "lost"}
            table.add_column(name, justify="right" if right else "left")
        for name, source in self.status["sources"].items():
            lost = sum(source["missed"].values()) + sum(source["dropped"].values())
            for i, (stream, figures) in enumerate(source["streams"].items()):
                clock = source["clocks"].get(stream)
                first = i == 0
                table.add_row(
                    name if first else "",
                    Text(source["state"], style=COLOUR[source["state"]]) if first else "",
                    stream,
                    "–" if figures["rate_hz"] is None else f"{figures['rate_hz']:.1f} Hz",
                    "–" if figures["jitter_p99_ms"] is None else f"{figures['jitter_p99_ms']:.2f} ms",
                    f"{clock['bound_ns'] * 1e-6:.2f} ms" if clock else "½ trip",
                    str(source["expected"]) if first else "",
                    str(source["received"]) if first else "",
                    Text(str(lost), style="red" if lost else "green") if first else "",
                    Text(source["error"] or "", style="red") if first else "",
                )
        return table

    def _motion(self) -> Text:
        text = Text("motion  ", style="bold")
        for interval in self.intervals:
            joints = "+".join(str(j) for j in interval["moving"]) or "rest"
            text.append(f" {joints} ", style="black on cyan" if interval["moving"] else "dim")
            text.append(f"{(interval['end'] - interval['start']) * 1e-9:.2f}s ", style="dim")
        if self.task:
            text.append(f"  {self.task['name']} × {self.task['repetition']} ({self.task['variant']})", style="bold")
        return text

    def _energy(self, energy: Mapping[str, Any]) -> Text:
        text = Text("energy  ", style="bold")
        text.append(f" {energy['task']} × {energy['repetition']}  {energy['total']:.0f} J ", style="bold")
        text.append(f"± {energy['uncertainty']:.1f} J  ", style="dim")
        unsure = energy.get("group_uncertainty") or {}
        ranked = sorted(energy["groups"].items(), key=lambda group: -abs(group[1]))
        for i, (name, value) in enumerate((name, value) for name, value in ranked if value):
            text.append(f"{' · ' * bool(i)}{name.replace('_', ' ')} {value:.1f}")
            if unsure.get(name) is not None:
                text.append(f" ± {unsure[name]:.2f}", style="dim")
        return text

    def _alarms(self) -> RenderableType:
        if not self.alarms:
            return Text("no alarm", style="green")
        lines = Text()
        for alarm in self.alarms.values():
            lines.append(f"{alarm['severity']}: {alarm['statement']}\n", style=SEVERITY[alarm["severity"]])
        lines.rstrip()
        return Panel(lines, title="alarms", border_style="red", expand=False)
