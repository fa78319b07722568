"""Metrics for Prometheus: the latest values of the cell, and sums of its energies."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from typing import Any, ClassVar, Final

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from cellwatt.frames import Frames, Layout
from cellwatt.outlet import CellView, Item, Outlet
from cellwatt.outlets.apart.outlet import Apart
from cellwatt.outlets.metrics.catalogue import CATALOGUE, Family, SeriesValue, lives_of, of_health
from cellwatt.outlets.metrics.settings import MetricsSettings
from cellwatt.outlets.selection import fits
from cellwatt.results import Energy
from cellwatt.version import __version__

LONGEST: Final = 200
"""Most characters of a label."""
_MOST_ENERGIES: Final = 10_000
"""Most series of energies."""
Sample = tuple[tuple[str, ...], float]


class Meter(Collector):
    """Collects frames, energies and health; ``samples`` returns at most ``most`` series per metric.

    ``channels``: patterns of the channels whose power is published; ``session``: the daemon's start, UTC ns.
    """

    def __init__(self, channels: Iterable[str], most: int, session: int) -> None:
        self._patterns, self._most, self._session = tuple(channels), most, session
        self._layout: Layout | None = None
        self._columns: tuple[tuple[int, str], ...] = ()
        self._power: dict[str, float] = {}
        self._figures: list[SeriesValue] = []
        self._looked: float | None = None
        self._energies: dict[tuple[str, tuple[str, ...]], float] = {}
        self._alarms: dict[tuple[str, ...], None] = {}
        self._lives: dict[str, tuple[int | None, float]] = {}
        """Process of each source and outlet, and its count that decreases only when it begins anew."""
        self._tops: dict[tuple[str, str, tuple[str, ...]], float] = {}
        """Highest value of each count that may decrease, by part, metric and labels."""
        self._shown: dict[str, set[tuple[str, ...]]] = {}
        self.scrapes = 0

    def succeed(self, before: Meter) -> None:
        """Take over the totals and the latest values of another meter."""
        self._lives, self._tops, self._energies = before._lives, before._tops, before._energies
        self._figures, self._looked = before._figures, before._looked
        self._alarms, self.scrapes = before._alarms, before.scrapes

    def frames(self, frames: Frames) -> None:
        """Store the power values of the newest frame."""
        if frames.layout is not self._layout:
            self._layout = frames.layout
            names = enumerate(frames.layout.names)
            chosen = ((i, n) for i, n in names if fits(n, self._patterns))
            self._columns = tuple((i, n) for i, n in chosen if frames.layout.channels[i].unit == "W")
        if len(frames):
            self._power = {name: float(frames.values[-1, i]) for i, name in self._columns}

    def energy(self, energy: Energy) -> None:
        """Add the energy of a finished task."""
        self._add("task_repetitions", (energy.task,), 1.0)
        self._add("energy_measured_joules", (energy.task,), energy.total)
        for group, value in energy.groups.items():
            self._add("energy_joules", (energy.task, group), value)
            self._add("energy_returned_joules", (energy.task, group), -value)

    def health(self, status: Mapping[str, Any]) -> None:
        """Store the cell's health."""
        self._looked = time.monotonic()
        for part, process, steady in lives_of(status):
            before, last = self._lives.get(part, (process, 0.0))
            if process != before or steady < last:
                self._tops = {key: top for key, top in self._tops.items() if key[0] != part}
            self._lives[part] = process, steady
        self._figures = [self._steady(figure) for figure in of_health(status)]
        now = {r.labels for r in self._figures if r.metric == "alarms_active"}
        # A cleared alarm is published as 0 from now on: a missing series would mean unknown.
        self._figures += [SeriesValue("alarms_active", labels, 0.0) for labels in self._alarms if labels not in now]
        for labels in now:
            if len(self._alarms) < self._most:
                self._alarms[labels] = None

    def samples(self) -> dict[str, list[Sample]]:
        """Series of each metric by name, in the order of the catalogue."""
        found: dict[str, dict[tuple[str, ...], float]] = {name: {} for name in CATALOGUE}
        for figure in self._all():
            series = found[f"cellwatt_{figure.metric}"]
            labels = tuple(label[:LONGEST] for label in figure.labels)
            if math.isfinite(figure.value):
                series[labels] = series.get(labels, 0.0) + figure.value
        out = {name: self._bounded(name, series) for name, series in found.items()}
        left = {(name,): float(len(found[name]) - len(out[name])) for name in found}
        out["cellwatt_series_left_out"] = [(name, n) for name, n in left.items() if n]
        return out

    def collect(self) -> Iterator[Metric]:
        """Families that have series, in the order of the catalogue."""
        return (_filled(CATALOGUE[name], samples) for name, samples in self.samples().items() if samples)

    def _all(self) -> Iterator[SeriesValue]:
        yield SeriesValue("build", (__version__,), 1.0)
        yield SeriesValue("session_start_time_seconds", (), 1e-9 * self._session)
        yield SeriesValue("scrapes", (), self.scrapes)
        if self._looked is not None:
            yield SeriesValue("health_age_seconds", (), time.monotonic() - self._looked)
        yield from self._figures
        yield from (SeriesValue("power_watts", (name,), value) for name, value in self._power.items())
        yield from (SeriesValue(metric, labels, value) for (metric, labels), value in self._energies.items())

    def _add(self, metric: str, labels: tuple[str, ...], value: float) -> None:
        key = metric, labels
        if math.isfinite(value) and (key in self._energies or len(self._energies) < _MOST_ENERGIES):
            self._energies[key] = self._energies.get(key, 0.0) + max(value, 0.0)

    def _steady(self, figure: SeriesValue) -> SeriesValue:
        """A count that may decrease, replaced by its highest value since its part began anew."""
        if figure.part is None:
            return figure
        key = figure.part, figure.metric, figure.labels
        self._tops[key] = max(figure.value, self._tops.get(key, 0.0))
        return figure._replace(value=self._tops[key])

    def _bounded(self, name: str, series: Mapping[tuple[str, ...], float]) -> list[Sample]:
        """The series to publish: those published before, then others up to the limit."""
        shown = self._shown.get(name, set()) & series.keys()
        for labels in series:
            if len(shown) >= self._most:
                break
            shown.add(labels)
        self._shown[name] = shown
        return [(labels, value) for labels, value in series.items() if labels in shown]


if find_spec("aiohttp") is None:  # only the serving process imports it; a missing one is reported at once
    raise ModuleNotFoundError("No module named 'aiohttp'", name="aiohttp")


def _filled(family: Family, samples: Sequence[Sample]) -> Metric:
    if family.type == "info":
        info = InfoMetricFamily(family.name, family.help)
        for labels, _ in samples:
            info.add_metric((), dict(zip(family.labels, labels, strict=True)))
        return info
    kind = CounterMetricFamily if family.type == "counter" else GaugeMetricFamily
    made = kind(family.name, family.help, labels=family.labels, unit=family.unit)
    for labels, value in samples:
        made.add_metric(labels, value)
    return made


def exposed(meter: Meter, accept: str) -> tuple[bytes, str]:
    """Text and content type for the reader's ``accept`` header: OpenMetrics, or the Prometheus text format."""
    encode, content_type = choose_encoder(accept)
    return encode(meter), content_type


class MetricsOutlet(Apart[MetricsSettings]):
    """Holds the latest values of the cell for readers; nothing is queued, so nothing is lost.

    A separate process serves. It requests the text when a reader connects, so that there is no cost without readers.
    """

    Settings: ClassVar[type[MetricsSettings]] = MetricsSettings
    title = "Prometheus: health, losses, alarms, power and energy as metrics"
    module = "cellwatt.outlets.metrics.serving"
    what = "the process that serves the metrics"
    memory = 256 << 20

    def __init__(self, name: str, settings: MetricsSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._meter = Meter(settings.channels, settings.series, view.session)

    def offer(self, item: Item) -> None:
        """Store the newest frame's power, and sum energies."""
        if isinstance(item, Frames):
            self._meter.frames(item)
        elif isinstance(item, Energy):
            self._meter.energy(item)

    def health(self, status: Mapping[str, Any]) -> None:
        """Store the cell's health."""
        self._meter.health(status)

    def succeed(self, before: Outlet[Any]) -> None:
        """Take over the totals of the previous outlet, so that no counter decreases."""
        if isinstance(before, MetricsOutlet):
            self._meter.succeed(before._meter)

    def answer(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """The text and content type for ``scrapes`` readers."""
        self._meter.scrapes += question["scrapes"]
        text, kind = exposed(self._meter, question["accept"])
        return {"text": text.decode(), "type": kind}
